"""Shapes: the contact generatrix of a body, exact, and the outline that is meshed.

Points are (r, z) [mm]. The axle is drawn in place, its seat's entrance at z = 0; the wheel is drawn in its own
frame, its leading face at z = 0, and travels towards +z. A contact line is a graph: height against coordinate,
r(z) where the gap is radial, z(r) where it is axial.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import singledispatch
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ..errors import MeshError
from ..scene.deviation import Deviation, check_cover, deviation_of
from ..scene.keys import Disc, Hub, MeshFile, MeshKeys, Scene, Shaft
from ..scene.profile import bore_profile, seat_profile

FloatArray = npt.NDArray[np.float64]
Point = tuple[float, float]

MOST_FACETS = 100_000
"""Most facets of a contact line: their dense matrices exceed any memory long before."""

FLATTEST = 1e-7
"""Height of an arc below which a piece of a file's contact line is straight, in its lengths."""


@dataclass(frozen=True)
class Sizes:
    """Lengths of the facets of a contact line [mm]: in general, in the arcs of its corners; and the growth between."""

    facet: float
    corner: float
    growth: float

    @classmethod
    def of(cls, keys: MeshKeys, contact: str) -> Sizes:
        """Those of the seat or the bore, by the keys of a scene."""
        bore_facet = 0.97 * keys.seat_facet if keys.bore_facet is None else keys.bore_facet
        facet, scale = (keys.seat_facet, 1.0) if contact == "seat" else (bore_facet, 0.97)
        return cls(facet, facet if keys.corner_facet is None else min(facet, scale * keys.corner_facet), keys.growth)


@dataclass(frozen=True, kw_only=True)
class Generatrix:
    """A contact line h(s) made of straight pieces and circular arcs, in ascending s.

    Piece k spans breaks[k] <= s <= breaks[k + 1]. With bend[k] = 0 it is the line
    h = height0[k] + slope0[k] (s - breaks[k]); with bend = +1 or -1 (centre below or above the line) it is the arc
    h = centre_h[k] + bend[k] sqrt(radius[k]^2 - (s - centre_s[k])^2).

    The surface that meets the other body may differ from what is drawn and meshed: a measured ``deviation`` comes on
    top, and a warm body is larger by its thermal strain.
    """

    breaks: FloatArray
    height0: FloatArray
    slope0: FloatArray
    bend: FloatArray
    centre_s: FloatArray
    centre_h: FloatArray
    radius: FloatArray
    deviation: Deviation | None = None
    thermal_strain: float = 0.0

    def height(self, s: FloatArray) -> FloatArray:
        """Height h(s) of the surface [mm]."""
        height = self._drawn_height(s)
        if self.deviation is not None:
            height = height + self.deviation.at(s)
        return height if self.thermal_strain == 0.0 else (1.0 + self.thermal_strain) * height

    def slope(self, s: FloatArray) -> FloatArray:
        """Slope dh/ds of the surface [-]."""
        slope = self._drawn_slope(s)
        if self.deviation is not None:
            slope = slope + self.deviation.slope(s)
        return slope if self.thermal_strain == 0.0 else (1.0 + self.thermal_strain) * slope

    def _drawn_height(self, s: FloatArray) -> FloatArray:
        k = self._piece(s)
        line = self.height0[k] + self.slope0[k] * (s - self.breaks[k])
        if not self.bend.any():
            return np.asarray(line)
        root = np.sqrt(np.maximum(self.radius[k] ** 2 - (s - self.centre_s[k]) ** 2, 0.0))
        return np.where(self.bend[k] == 0.0, line, self.centre_h[k] + self.bend[k] * root)

    def _drawn_slope(self, s: FloatArray) -> FloatArray:
        k = self._piece(s)
        if not self.bend.any():
            return self.slope0[k]
        offset = s - self.centre_s[k]
        root = np.sqrt(np.maximum(self.radius[k] ** 2 - offset**2, 1e-300))
        return np.where(self.bend[k] == 0.0, self.slope0[k], -self.bend[k] * offset / root)

    def bends(self, s: FloatArray) -> npt.NDArray[np.bool_]:
        """Whether each s lies in an arc."""
        return np.asarray(self.bend[self._piece(s)] != 0.0)

    def nodes(self, sizes: Sizes) -> FloatArray:
        """Coordinates of the facets' ends: every piece divided as ``sizes`` say, the graded ones by equal shares.

        Beside an arc whose facets are shorter, the wanted length is h(s) = min(facet, corner + growth distance), and
        a piece has the nodes where the integral of ds / h passes the multiples of an n-th of its total.

        Raises:
            MeshError: there would be too many.
        """
        bends = self.bend != 0.0
        least = np.where(bends, sizes.corner, sizes.facet)
        if float((np.diff(self.breaks) / least).sum()) > MOST_FACETS:
            raise MeshError(
                f"a contact line of {self.breaks[-1] - self.breaks[0]:.4g} mm takes more than {MOST_FACETS} facets: "
                f"lengthen mesh.seat_facet, mesh.bore_facet or mesh.corner_facet"
            )
        starts, ends = self.breaks[:-1][bends], self.breaks[1:][bends]
        pieces = []
        for a, b, bend in zip(self.breaks[:-1], self.breaks[1:], bends, strict=True):
            if bend or not len(starts) or sizes.corner >= sizes.facet:
                length = sizes.corner if bend else sizes.facet
                pieces.append(np.linspace(a, b, max(1, round((b - a) / length)), endpoint=False))
                continue
            s = np.linspace(a, b, 2 + math.ceil(8.0 * (b - a) / sizes.corner))
            distance = np.maximum(starts[:, None] - s, s - ends[:, None]).min(axis=0)
            wanted = np.minimum(sizes.facet, sizes.corner + sizes.growth * distance)
            passed = np.append(0.0, np.cumsum(np.diff(s) * 0.5 * (1.0 / wanted[1:] + 1.0 / wanted[:-1])))
            shares = np.linspace(0.0, passed[-1], max(1, round(passed[-1])), endpoint=False)
            pieces.append(np.interp(shares, passed, s))
        return np.append(np.concatenate(pieces), self.breaks[-1])

    def _piece(self, s: FloatArray) -> npt.NDArray[np.intp]:
        piece = np.searchsorted(self.breaks, s, side="right") - 1
        return np.minimum(np.maximum(piece, 0), len(self.height0) - 1)


@dataclass(frozen=True)
class Edge:
    """A straight edge of an outline with the name of its boundary ('' for a free one)."""

    start: Point
    end: Point
    name: str
    corner: bool = False  # a facet in one of the contact line's arcs


@dataclass(frozen=True)
class Drawing:
    """A body's outline, counted around once, and the exact contact generatrix among its edges."""

    edges: tuple[Edge, ...]
    generatrix: Generatrix
    contact: str  # name of the contact line, "seat" or "bore"
    sizes: Sizes


def with_profile(line: Generatrix, scene: Scene, body: str) -> Generatrix:
    """The contact line of a body with the profile that the scene gives it on top.

    Raises:
        SceneError: the profile cannot be read, or does not cover the line.
    """
    deviation = deviation_of(scene, body)
    if deviation is None:
        return line
    if isinstance(getattr(scene, body), MeshFile):  # of a drawn body the keys tell
        check_cover(deviation, float(line.breaks[0]), float(line.breaks[-1]))
    return replace(line, deviation=deviation)


def polyline(points: FloatArray, middles: FloatArray | None = None) -> Generatrix:
    """The generatrix through points (s, h) in ascending s, and between them through ``middles``: what a file gives.

    An arc passes through both ends and the middle (s, h) of a piece that is curved, a line otherwise.
    """
    s, h = points.T
    zero = np.zeros(len(s) - 1)
    line = Generatrix(
        breaks=s.copy(),
        height0=h[:-1].copy(),
        slope0=np.diff(h) / np.diff(s),
        bend=zero,
        centre_s=zero,
        centre_h=zero,
        radius=np.ones(len(s) - 1),
    )
    return line if middles is None else _curved(line, points, middles)


def _curved(line: Generatrix, points: FloatArray, middles: FloatArray) -> Generatrix:
    """The generatrix with the circle through the ends and the middle of each piece that is not straight."""
    a, b, m = points[:-1], points[1:], middles
    chord = b - a
    length = np.hypot(*chord.T)
    cross = chord[:, 0] * (m - a)[:, 1] - chord[:, 1] * (m - a)[:, 0]
    bends = np.abs(cross) > FLATTEST * length**2
    doubled = np.where(bends, 2.0 * cross, 1.0)
    square_b, square_m = (chord**2).sum(axis=1), ((m - a) ** 2).sum(axis=1)
    centre_s = (square_m * -chord[:, 1] + square_b * (m - a)[:, 1]) / doubled
    centre_h = (square_m * chord[:, 0] - square_b * (m - a)[:, 0]) / doubled
    return replace(
        line,
        bend=np.where(bends, np.sign(cross), 0.0),
        centre_s=np.where(bends, a[:, 0] + centre_s, 0.0),
        centre_h=np.where(bends, a[:, 1] + centre_h, 0.0),
        radius=np.where(bends, np.hypot(centre_s, centre_h), 1.0),
    )


def blended(points: list[Point], blends: list[float]) -> Generatrix:
    """The polyline through (s, h) ``points`` with an arc of radius ``blends[i]`` at its inner vertex i + 1.

    An arc touches both lines at the tangent length R tan(alpha / 2) from the corner of angle alpha.
    """
    pieces: list[tuple[float, ...]] = []
    start = points[0]
    for i in range(len(points) - 1):
        (s0, h0), (s1, h1) = points[i], points[i + 1]
        slope, angle = (h1 - h0) / (s1 - s0), math.atan2(h1 - h0, s1 - s0)
        end, arc = (s1, h1), None
        if i + 2 < len(points) and blends[i] > 0.0:
            s2, h2 = points[i + 2]
            after = math.atan2(h2 - h1, s2 - s1)
            reach = blends[i] * math.tan(0.5 * abs(after - angle))
            end = (s1 - reach * math.cos(angle), h1 - reach * math.sin(angle))
            bend = -math.copysign(1.0, after - angle)
            centre = (
                end[0] + bend * blends[i] * math.sin(angle),
                end[1] - bend * blends[i] * math.cos(angle),
            )
            arc = (end[0], end[1], slope, bend, *centre, blends[i])
        if end[0] - start[0] > 1e-12:
            pieces.append((start[0], start[1], slope, 0.0, 0.0, 0.0, 1.0))
        start = end
        if arc is not None:
            pieces.append(arc)
            start = (s1 + reach * math.cos(after), h1 + reach * math.sin(after))
    return _assemble(pieces, points[-1][0])


def _assemble(pieces: list[tuple[float, ...]], end: float) -> Generatrix:
    table = np.array(pieces).T
    rest = ("height0", "slope0", "bend", "centre_s", "centre_h", "radius")
    return Generatrix(breaks=np.append(table[0], end), **dict(zip(rest, table[1:], strict=True)))


@singledispatch
def draw_body(body: object, contact: str, sizes: Sizes) -> Drawing:
    """The outline and generatrix of a body; ``contact`` names its contact line, 'seat' or 'bore'."""
    raise TypeError(f"nothing to draw for {type(body).__name__}")


@draw_body.register
def _(axle: Shaft, contact: str, sizes: Sizes) -> Drawing:
    length, taper = axle.seat_length, axle.taper_length
    profile = seat_profile(axle)
    mouth, end = profile[0][1], profile[-1][1]
    generatrix = blended(profile, [axle.taper_blend])
    lead = mouth if axle.lead_radius is None else axle.lead_radius
    tail = end if axle.tail_radius is None else axle.tail_radius
    first, last, inner = -taper - axle.lead_length, length + axle.tail_length, axle.inner_radius
    corners: list[tuple[Point, str, float]] = [  # corner, name of the edge that ends there, fillet
        ((tail, length), "", axle.tail_blend),
        ((tail, last), "", 0.0),
        ((inner, last), "held", 0.0),
        ((inner, first), "axis" if inner == 0.0 else "", 0.0),
        ((lead, first), "", 0.0),
        ((lead, -taper), "", 0.0),
        ((mouth, -taper), "", 0.0),
    ]
    contact_edges = _contact_edges(generatrix, sizes, contact, radial=True)
    return Drawing((*contact_edges, *_closing((end, length), corners)), generatrix, contact, sizes)


@draw_body.register
def _(wheel: Hub, contact: str, sizes: Sizes) -> Drawing:
    profile = bore_profile(wheel)
    (rear, bore), mouth = profile[0], profile[-1]
    closing = [((bore, rear), "pushed", 0.0)]
    if wheel.rear_edge_blend > 0.0:
        edge = _rear_edge(rear, bore, 0.5 * wheel.bore_taper, wheel.rear_edge_blend)
        profile[0] = edge.tangent
        generatrix, closing = edge.rounded(blended(profile, [wheel.chamfer_blend])), edge.closing()
    else:
        generatrix = blended(profile, [wheel.chamfer_blend])
    corners = [
        ((wheel.hub_outer_radius, 0.0), "", 0.0),
        *_web(wheel),
        ((wheel.hub_outer_radius, rear), "", 0.0),
    ]
    contact_edges = _contact_edges(generatrix, sizes, contact, radial=True)
    return Drawing((*contact_edges, *_closing((mouth[1], 0.0), [*corners, *closing])), generatrix, contact, sizes)


@draw_body.register
def _(disc: Disc, contact: str, sizes: Sizes) -> Drawing:
    reach = disc.radius if disc.contact_radius is None else disc.contact_radius
    inside = 1.0 if contact == "seat" else -1.0  # the held disc lies above its contact face, the pushed one below
    crown = disc.crown_radius

    def face(r: float) -> float:
        return inside * (crown - math.sqrt(crown**2 - r**2)) if crown > 0.0 else 0.0

    piece = (0.0, 0.0, 0.0, -inside, 0.0, inside * crown, crown) if crown > 0.0 else (0.0,) * 6 + (1.0,)
    generatrix = _assemble([piece], reach)
    beyond = np.linspace(reach, disc.radius, 33 if crown > 0.0 else 2)[1:]
    back, name = inside * disc.thickness, "held" if contact == "seat" else "pushed"
    corners = [((float(r), face(float(r))), "", 0.0) for r in beyond]
    corners += [((disc.radius, back), "", 0.0), ((0.0, back), name, 0.0), ((0.0, 0.0), "axis", 0.0)]
    contact_edges = _contact_edges(generatrix, sizes, contact, radial=False)
    return Drawing((*contact_edges, *_closing((reach, face(reach)), corners)), generatrix, contact, sizes)


def _contact_edges(generatrix: Generatrix, sizes: Sizes, name: str, *, radial: bool) -> list[Edge]:
    s = generatrix.nodes(sizes)
    h = generatrix.height(s)
    points = (
        list(zip(h.tolist(), s.tolist(), strict=True)) if radial else list(zip(s.tolist(), h.tolist(), strict=True))
    )
    corners = generatrix.bends(0.5 * (s[1:] + s[:-1])).tolist()
    return [Edge(a, b, name, bend) for (a, b), bend in zip(pairwise(points), corners, strict=True)]


def _closing(start: Point, corners: list[tuple[Point, str, float]]) -> list[Edge]:
    """The edges from ``start`` around the corners, fillets replaced by chords of at most 15 degrees."""
    edges: list[Edge] = []
    here = start
    for i, (corner, name, fillet) in enumerate(corners):
        path = [corner]
        if fillet > 0.0 and i + 1 < len(corners):
            path = _fillet(here, corner, corners[i + 1][0], fillet)
        for point in path:
            if math.dist(here, point) > 1e-9:
                edges.append(Edge(here, point, name))
            here = point
    return edges


def _fillet(before: Point, corner: Point, after: Point, radius: float) -> list[Point]:
    a, p, b = (np.array(x) for x in (before, corner, after))
    d1, d2 = (p - a) / np.linalg.norm(p - a), (b - p) / np.linalg.norm(b - p)
    angle = math.acos(float(np.clip(d1 @ d2, -1.0, 1.0)))
    turn = math.copysign(1.0, float(d1[0] * d2[1] - d1[1] * d2[0]))
    start = p - radius * math.tan(0.5 * angle) * d1
    normal = turn * np.array([-d1[1], d1[0]])
    centre = start + radius * normal
    steps = np.linspace(0.0, angle, max(3, math.ceil(angle / math.radians(15.0))) + 1)
    return [tuple((centre + radius * (math.sin(t) * d1 - math.cos(t) * normal)).tolist()) for t in steps]


@dataclass(frozen=True)
class _RearEdge:
    """An arc between the rear face and the bore: up to 45 degrees it belongs to the contact line, the rest does not."""

    radius: float
    centre: Point  # (z, r) [mm]
    tangent: Point  # (z, r) where it touches the bore [mm]

    def rounded(self, generatrix: Generatrix) -> Generatrix:
        """The contact line from its tangent point on, with the arc before it."""
        half = self.radius * math.sqrt(0.5)
        arc = (self.centre[0] - half, self.centre[1] - half, -1.0, -1.0, *self.centre, self.radius)
        columns = ("height0", "slope0", "bend", "centre_s", "centre_h", "radius")
        rows = np.array([generatrix.breaks[:-1], *(getattr(generatrix, name) for name in columns)]).T
        return _assemble([arc, *(tuple(row) for row in rows)], float(generatrix.breaks[-1]))

    def closing(self) -> list[tuple[Point, str, float]]:
        """The rest of the arc, from the rear face to the contact line."""
        angles = np.radians([90.0, 75.0, 60.0, 45.0])
        (z, r), radius = self.centre, self.radius
        rest = [(r - radius * math.cos(t), z - radius * math.sin(t)) for t in angles]
        return [(rest[0], "pushed", 0.0)] + [(point, "", 0.0) for point in rest[1:]]


def _rear_edge(rear: float, bore: float, slope: float, radius: float) -> _RearEdge:
    """The arc that touches the rear face z = rear and the bore r = bore + slope (z - rear) from above."""
    steep = math.hypot(1.0, slope)
    centre = (rear + radius, bore + radius * (slope + steep))
    return _RearEdge(radius, centre, (centre[0] + radius * slope / steep, centre[1] - radius / steep))


def _web(wheel: Hub) -> list[tuple[Point, str, float]]:
    """Corners of web and rim, from the leading side of the web to its rear side; none for a plain ring."""
    if wheel.web_thickness == 0.0:
        return []
    middle = -0.5 * wheel.hub_length + wheel.web_offset
    web, rim, fillet = 0.5 * wheel.web_thickness, 0.5 * wheel.rim_width, wheel.web_blend
    hub_r, inner, outer = wheel.hub_outer_radius, wheel.rim_inner_radius, wheel.rim_outer_radius
    return [
        ((hub_r, middle + web), "", fillet),
        ((inner, middle + web), "", fillet),
        ((inner, middle + rim), "", 0.0),
        ((outer, middle + rim), "", 0.0),
        ((outer, middle - rim), "", 0.0),
        ((inner, middle - rim), "", 0.0),
        ((inner, middle - web), "", fillet),
        ((hub_r, middle - web), "", fillet),
    ]
