"""Profiles as strangers write them: each way of writing is read, each mistake is one line with key, file and line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from small import NO_FIELDS

from macrofit.bodies.geometry import polyline
from macrofit.cli import main
from macrofit.errors import OutputError, SceneError
from macrofit.results.foresight import foreseen
from macrofit.results.journal import Journal, named_files
from macrofit.scene import Scene, build_scene, dump_scene, idle_keys, load_scene
from macrofit.scene.deviation import Deviation, deviation_of, read_profile

MESHES = Path(__file__).parents[3] / "meshes"
PLAIN = "0,1.5\n90,-2\n185,4\n"


def macrofit(*arguments: object) -> Result:
    return CliRunner(mix_stderr=False).invoke(main, [str(argument) for argument in arguments])


def scene_with(folder: Path, text: str | bytes, body: str = "axle", *overrides: str) -> Scene:
    """The wheelset (seat and hub of 190 mm) with a profile of this text."""
    file = folder / "profile.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_scene("wheelset", [*NO_FIELDS, f"{body}.profile={file}", *overrides])


def read(folder: Path, text: str | bytes, body: str = "axle") -> Deviation:
    found = deviation_of(scene_with(folder, text, body), body)
    assert found is not None
    return found


@pytest.mark.parametrize(
    "text",
    [
        PLAIN,
        "z_mm,deviation_um\n" + PLAIN,
        "# probe 3\n\nz [mm];dev [µm]\n0;1,5\n90;-2\n185;4,0\n",
        b"\xef\xbb\xbfz_mm\tdeviation_um\r\n0\t1.5\r\n90\t-2\r\n185\t4\r\n",
        "\ufeffz;r\nmm;um\n0;1,5\n90;-2\n185;4\n".encode("utf-16-le"),
        "z_m;deviation_mm\n0;0,0015\n0,090;-0,002\n0,185;0,004\n",
        "  0   1.5\n 90  -2.0\n185   4.0\n",
    ],
    ids=["plain", "header", "german", "BOM and tabs", "UTF-16 with a row of units", "other units", "blanks"],
)
def test_a_profile_is_read_as_it_is_written(text: str | bytes, tmp_path: Path) -> None:
    found = read(tmp_path, text)
    np.testing.assert_allclose(found.z, [0.0, 90.0, 185.0], rtol=1e-12)
    np.testing.assert_allclose(found.value, [1.5e-3, -2e-3, 4e-3], rtol=1e-12)


def test_the_bore_is_measured_from_its_leading_face(tmp_path: Path) -> None:
    """z grows into the bore, against the z of its drawing; beyond the ends the deviation stays."""
    found = read(tmp_path, PLAIN, "wheel")
    np.testing.assert_allclose(found.at(np.array([0.0, -45.0, -90.0, -190.0])), [1.5e-3, -0.25e-3, -2e-3, 4e-3])
    np.testing.assert_allclose(found.slope(np.array([-189.0, -100.0, -1.0])), [0.0, -6e-3 / 95.0, 3.5e-3 / 90.0])


def test_height_and_slope_are_of_the_surface(tmp_path: Path) -> None:
    """The drawn line, the deviation on it, and both larger by the thermal strain; nodes stay where they are drawn."""
    import dataclasses

    line = polyline(np.array([[0.0, 95.0], [190.0, 95.19]]))
    s = np.linspace(0.5, 184.5, 8)
    deviation = read(tmp_path, PLAIN)
    surface = dataclasses.replace(line, deviation=deviation, thermal_strain=1e-3)
    np.testing.assert_allclose(surface.height(s), 1.001 * (95.0 + 1e-3 * s + deviation.at(s)), rtol=1e-14)
    differences = (surface.height(s + 1e-4) - surface.height(s - 1e-4)) / 2e-4
    np.testing.assert_allclose(surface.slope(s), differences, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "body", "said"),
    [
        ("", "axle", "is empty"),
        ("0,1\n", "axle", "line 1: a profile needs two points at least"),
        ("z,dev\n0,1\n50,2\n50,3\n190,1\n", "axle", "line 4: z = 50 after 50; z must grow from row to row: sort the"),
        ("190,1\n90,2\n0,1\n", "axle", "line 2: z = 90 after 190; z must grow from row to row: turn the order"),
        ("1,0\n-2,90\n4,190\n", "axle", "line 2: z = -2 after 1; z must grow from row to row: are the two columns"),
        ("0,1\n90,nan\n190,1\n", "axle", "line 2: '90,nan' is not two finite numbers"),
        ("0,1\n90,\n190,1\n", "axle", "line 2: '90,' is not two finite numbers"),
        ("0,1,2\n90,1,2\n190,1,2\n", "axle", "has 3 columns; a profile has two"),
        ("0,1\n100,1\n", "axle", "reaches from z = 0 to 100 mm, and the fit from 0 to 180 mm; z = 0 is the seat's"),
        ("0,1\n0.19,1\n", "axle", "is z in m? write z_m in the header"),
        ("-190,1\n0,1\n", "wheel", "z grows from the leading face (0) into the bore: turn its sign"),
        ("40,1\n190,1\n", "wheel", "reaches from z = 40 to 190 mm, and the fit from 10 to 190 mm; z = 0 is the bore's"),
        ("z_mm,force_kN\n0,1\n190,1\n", "axle", "unit 'kN' in its header is not known: take mm, cm, m, in or um"),
        ("0,95.1\n190,94.9\n", "axle", "are these radii or diameters?"),
        ("0,189.9\n190,190.1\n", "axle", "are these radii or diameters?"),
        ("z_mm,r_mm\n0,95.1\n190,94.9\n", "axle", "are these radii or diameters?"),
        ("z;Durchmesser\nmm;um\n0;3\n190;4\n", "axle", "'Durchmesser' in its header is of the diameter; halve the"),
        ("z [mm],diameter deviation [um]\n0,3\n190,4\n", "wheel", "is of the diameter; halve the numbers"),
        ("0,5000\n190,1\n", "axle", "a deviation of 5 mm of a radius of 95 mm is beyond small strain"),
        (b"PK\x03\x04rest of a sheet", "axle", "is no text but a spreadsheet or an archive; save it as CSV"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(text: str | bytes, body: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError) as caught:
        scene_with(tmp_path, text, body)
    message = str(caught.value)
    assert message.startswith(f"{body}.profile: {tmp_path / 'profile.csv'}: ")
    assert said in message
    assert "\n" not in message


def test_a_file_that_is_not_there_ends_with_2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shown = macrofit("check", "wheelset", "--set", "axle.profile=nowhere.csv")
    assert shown.exit_code == 2
    assert "axle.profile: " in shown.stderr
    assert "nowhere.csv" in shown.stderr
    assert len(shown.stderr.strip().splitlines()) == 1


def test_a_profile_is_looked_for_beside_the_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As mesh files are, and the scene that is written back finds it from anywhere."""
    (tmp_path / "seat.csv").write_text(PLAIN)
    text = dump_scene(load_scene("wheelset")).replace("[axle]\n", '[axle]\nprofile = "seat.csv"\n', 1)
    (tmp_path / "scene.toml").write_text(text)
    monkeypatch.chdir("/")
    scene = load_scene(tmp_path / "scene.toml")
    assert named_files(scene) == {"axle.profile": str(tmp_path / "seat.csv")}
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "scene.toml").write_text(dump_scene(scene))
    assert load_scene(tmp_path / "elsewhere" / "scene.toml") == scene


def test_a_run_is_not_resumed_with_another_profile(tmp_path: Path) -> None:
    """Neither with another content under the same name, nor without it."""
    from fakes import fake_increment

    scene = scene_with(tmp_path, PLAIN)
    with Journal.start(tmp_path / "journal.bin", scene) as journal:
        journal.append(fake_increment(0, 1.0, 2.0), {})
    Journal.resume(tmp_path / "journal.bin", scene).close()
    with pytest.raises(OutputError, match=r"another scene \(changed: content of axle\.profile\)"):
        Journal.resume(tmp_path / "journal.bin", scene_with(tmp_path, PLAIN.replace("-2", "-3")))
    with pytest.raises(OutputError, match=r"changed: axle\.profile, content of axle\.profile"):
        Journal.resume(tmp_path / "journal.bin", load_scene("wheelset", NO_FIELDS))


def test_a_body_from_a_file_has_a_profile_too(tmp_path: Path) -> None:
    """On top of what the mesh has; the profile must cover its seat."""
    (tmp_path / "seat.csv").write_text("-20,5\n400,5\n")
    files = {"axle": str(MESHES / "axle.msh"), "wheel": str(MESHES / "wheel.msh")}
    tables = {"mesh": files, "motion": {"travel": 50.0}, "axle": {"profile": str(tmp_path / "seat.csv")}}
    from macrofit.bodies.approach import sides_of

    s = np.linspace(10.0, 100.0, 7)
    plain, profiled = (sides_of(build_scene(each))[0].line for each in ({**tables, "axle": {}}, tables))
    np.testing.assert_allclose(profiled.height(s) - plain.height(s), 5e-3, rtol=1e-9)
    (tmp_path / "seat.csv").write_text("0,5\n40,5\n")
    with pytest.raises(SceneError, match=r"axle\.profile: .*reaches from z = 0 to 40 mm"):
        sides_of(build_scene(tables))


@pytest.mark.parametrize(
    ("text", "doubt"),
    [
        (PLAIN, None),
        ("0,0.004\n185,-0.012\n", "small profile: axle.profile deviates by 0.012 um at most"),
        ("0,4\n185,1200\n", "large profile: axle.profile deviates by up to 1200 um, 4 times the interference"),
        ("\n".join(f"{0.05 * k},{10 * (-1) ** k}" for k in range(3801)), "rough profile: axle.profile varies by 10 um"),
        ("\n".join(f"{0.05 * k},{0.1 * k}" for k in range(3801)), None),
        ("0,90\n100,96\n185,94\n", None),
        ("z_mm,deviation_um\n0,95\n185,95\n", None),
    ],
    ids=["sound", "small", "large", "rough", "a slope of many points", "100 um", "95 um, stated"],
)
def test_what_looks_wrong_is_doubted(text: str, doubt: str | None, tmp_path: Path) -> None:
    said = [line for line in foreseen(scene_with(tmp_path, text)) if " profile: " in line]
    assert len(said) == (doubt is not None)
    assert doubt is None or said[0].startswith(doubt)


def test_check_says_what_it_takes(tmp_path: Path) -> None:
    (tmp_path / "seat.csv").write_text(PLAIN)
    keys = (f"axle.profile={tmp_path / 'seat.csv'}", "wheel.temperature=40")
    drawn = tmp_path / "section.svg"
    shown = macrofit("check", "wheelset", "-o", drawn, *(part for key in keys for part in ("--set", key)))
    assert shown.exit_code == 0, shown.stderr
    assert "Axle profile    3 points from z = 0 to 185 mm, radius -2 to +4 um, assumed to be in um" in shown.stdout
    assert "Heated wheel    its bore is wider by 0.0460% at the start" in shown.stdout
    assert "axle.profile = seat.csv" in drawn.read_text()


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ("wheel.temperature=-20", "wheel.temperature: "),
        ("wheel.temperature=900", "wheel.temperature: "),
        ("axle.temperature=-150", "axle.temperature: the axle has that of the surroundings; wheel.temperature says"),
        ("wheel.material.expansion=0", "wheel.material.expansion: "),
        ("wheel.material.expansion=11.5", "wheel.material.expansion: "),
        ("motion.cooling=4", "motion.cooling: 4 increments of a wheel that is not heated; give wheel.temperature too"),
        ("motion.cooling=-1", "motion.cooling: "),
    ],
)
def test_a_mistake_about_heat_is_one_line(overrides: str, said: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene("wheelset", overrides.split())
    assert str(caught.value).startswith(said)
    assert "\n" not in str(caught.value)


def test_only_the_wheel_is_heated_and_only_a_radius_grows() -> None:
    files = {"axle": str(MESHES / "axle.msh"), "wheel": str(MESHES / "wheel.msh")}
    with pytest.raises(SceneError, match=r"axle\.temperature: the axle has that of the surroundings"):
        build_scene({"mesh": files, "motion": {"travel": 50.0}, "axle": {"temperature": 20.0}})
    axial = {"mesh": files, "motion": {"travel": 50.0}, "contact": {"direction": "axial"}}
    with pytest.raises(SceneError, match=r"wheel\.temperature: changes the radius .* the gap is axial here"):
        build_scene({**axial, "wheel": {"temperature": 20.0}})


def test_expansion_is_that_of_key_card_or_steel() -> None:
    def strain(*keys: str) -> float:
        return load_scene("wheelset", ["wheel.temperature=100", *keys]).thermal_strain

    assert strain() == pytest.approx(1.15e-3)
    assert strain("wheel.material.grade=ER7") == pytest.approx(1.15e-3)
    assert strain("wheel.material.grade=ER7", "wheel.material.expansion=1.2e-5") == pytest.approx(1.2e-3)


def test_heat_that_does_nothing_is_said() -> None:
    lines = idle_keys(load_scene("wheelset", ["wheel.material.expansion=1.2e-5", "axle.material.expansion=1.1e-5"]))
    assert [line.partition(" = ")[0] for line in lines] == ["wheel.material.expansion", "axle.material.expansion"]


def test_a_wheel_cools_before_it_moves() -> None:
    keys = ["wheel.temperature=200", "motion.cooling=4", "motion.start=188", "motion.travel=190"]
    scene = load_scene("wheelset", keys)
    assert scene.displacements == (188.0,) * 5 + (189.0, 190.0)
    strains = [scene.thermal_strain_at(k) for k in range(7)]
    assert strains == pytest.approx([2.3e-3, 1.725e-3, 1.15e-3, 0.575e-3, 0.0, 0.0, 0.0])
    assert [doubt for doubt in foreseen(scene) if doubt.startswith("hot wheel")] == []
    hot = load_scene("wheelset", [*keys, "wheel.temperature=260"])
    assert any(doubt.startswith("hot wheel: 260 K") for doubt in foreseen(hot))


def test_a_hot_bore_may_enter_where_a_cold_one_cannot() -> None:
    """A plain bore without taper and chamfer, narrower than the seat until it is warm."""
    from macrofit.drafts.write import drawing

    tables = drawing("hub")
    for key in ("taper_length", "taper_height", "taper_blend"):
        tables["axle"].pop(key)
    for key in ("chamfer_length", "chamfer_height", "chamfer_blend"):
        tables["wheel"].pop(key)
    tables["axle"].pop("lead_length")
    with pytest.raises(SceneError, match=r"wheel\.chamfer_height: the bore's mouth"):
        build_scene(tables)
    tables["wheel"]["temperature"] = 200.0
    build_scene(tables)


def test_the_snippets_of_the_page_make_a_scene(tmp_path: Path) -> None:
    """docs/your-own-wheel.md: its tables and its CSV, on the draft of a hub; it cools where it will stay."""
    import tomllib

    from macrofit.drafts.write import drawing

    page = (Path(__file__).parents[3] / "docs" / "your-own-wheel.md").read_text()
    blocks = page.split("```")[1::2]
    tables = drawing("hub")
    tables["motion"] = {}
    for block in blocks:
        if block.startswith("toml\n"):
            for table, keys in tomllib.loads(block.removeprefix("toml\n")).items():
                tables[table] |= keys
    (csv,) = [block.lstrip("\n") for block in blocks if "z_mm;deviation_um" in block]
    for name in ("seat.csv", "bore.csv"):
        (tmp_path / name).write_text(csv)
    scene = build_scene(tables, tmp_path)
    assert len(scene.displacements) == 11
    assert idle_keys(scene) == []
    seat = deviation_of(scene, "axle")
    assert seat is not None
    assert seat.at(np.array([20.0])) == pytest.approx(3.4e-3)


def test_a_profile_is_read_once_and_anew_where_it_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks, bodies and what is foreseen ask for it: one of 3 MB takes 2 s to read."""
    import macrofit.scene.deviation as module
    from macrofit.bodies.approach import sides_of

    read = []

    def counted(file: Path, key: str) -> Deviation:
        read.append(file)
        return read_profile(file, key)

    monkeypatch.setattr(module, "read_profile", counted)
    scene = scene_with(tmp_path, "0;1\n190;1\n", "axle")
    sides_of(scene)
    foreseen(scene)
    assert len(read) == 1
    (tmp_path / "profile.csv").write_text("0;10\n190;10\n")
    changed = deviation_of(scene, "axle")
    assert changed is not None
    assert changed.largest == pytest.approx(0.01)
    assert len(read) == 2
