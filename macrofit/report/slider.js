"use strict";
(function () {
  const data = JSON.parse(document.getElementById("seat-data").textContent);
  const slider = document.getElementById("slider");
  const facets = data.edges.length - 1;

  function unpacked(text) {
    const raw = atob(text), values = new Int16Array(raw.length / 2);
    for (let i = 0; i < values.length; i++) {
      values[i] = raw.charCodeAt(2 * i) | (raw.charCodeAt(2 * i + 1) << 8);
    }
    return values;
  }
  for (const line of data.lines) line.values = unpacked(line.values);

  function stairs(line, k) {
    let d = "";
    for (let i = 0; i < facets; i++) {
      const y = (line.zero + line.pixels * line.values[k * facets + i]).toFixed(2);
      d += (i ? "V" + y : "M" + data.edges[0] + " " + y) + "H" + data.edges[i + 1];
    }
    return d;
  }

  function show(k) {
    for (const line of data.lines) document.getElementById(line.name).setAttribute("d", stairs(line, k));
    const dot = document.getElementById("dot");
    dot.setAttribute("cx", data.dot[0][k]);
    dot.setAttribute("cy", data.dot[1][k]);
    for (const place of document.querySelectorAll("data[data-column]")) {
      const value = data.columns[place.dataset.column][k];
      place.value = String(value);
      place.textContent = String(Number((value * Number(place.dataset.factor)).toPrecision(5)));
    }
  }

  slider.addEventListener("input", function () { show(Number(slider.value)); });
  show(Number(slider.value));
})();
