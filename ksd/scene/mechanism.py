"""`Mechanism`, with which an engineer describes a mechanism statement by statement."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, Self

from numpy.typing import ArrayLike

from ksd.checks import (
    PERPENDICULAR,
    Axis,
    ClearArgumentErrors,
    Vector,
    as_given,
    clear_argument_errors_of_methods,
    direction,
    dot,
    made_perpendicular,
    name_hint,
    names_of,
    number,
    show,
    unit,
    unused_name,
    vector,
    whole_checks_enabled,
    word,
)
from ksd.errors import SceneError, UnknownNameError, UnknownWordError
from ksd.html import NotebookTables
from ksd.scene.curve import Curve
from ksd.scene.drive import GROUND, Drive, DriveTerm, direction_suffix
from ksd.scene.effects import (
    OPTIONAL_EFFECTS,
    Compliance,
    Distance,
    Fit,
    Heat,
    LinkMatrix,
    Spring,
    TurnSpring,
)
from ksd.scene.hinges import Hinge, check_drive_in_plane, check_hinge_in_plane, check_plane, plane_normal
from ksd.scene.joint import Joint
from ksd.scene.leaf import Leaf
from ksd.scene.leaf import wire as make_wire
from ksd.scene.line_load import LineLoad, Pressure
from ksd.scene.link import Link, link_name
from ksd.scene.link_matrix import link_matrix
from ksd.scene.load import Load, PointMass
from ksd.scene.material import Material
from ksd.scene.obstacle import Cable, Contact, Stop, Surface, check_leaf_pair, check_pair
from ksd.scene.profile import Profile
from ksd.scene.rules import check_scene
from ksd.scene.scene import (
    LeafPoint,
    PlacedJoint,
    PlacedLeaf,
    Scene,
    global_leaf,
    hold_same_objects,
    joint_angle,
    joint_rotation,
)
from ksd.scene.sensor import Damper, Sensor
from ksd.scene.shapes import ContactShape
from ksd.scene.simulation import Simulation
from ksd.section import Section
from ksd.section.closed_forms import round_ratio

SETTABLE_ATTRIBUTES = ("name", "plane", "gravity", "simulation", "report")
"""Attributes of a mechanism that can be assigned; everything else is described by its methods."""
REPORT_WORDS = ("link", "at", "along", "freed")
"""Keys of `Mechanism.report`."""
FUNCTIONS_OF_KSD = (
    "solve",
    "prepare",
    "sweep",
    "batch",
    "doctor",
    "compare",
    "optimise",
    "follow",
    "gradient",
    "simulate",
)
"""Functions that take a mechanism, and are no methods of it."""
SYNONYMS = {
    "drive": "actuate", "move": "actuate", "prescribe": "actuate", "fix": "support", "hold": "support", "clamp": "support",
    "force": "load", "moment": "load", "torque": "load", "distributed_load": "line_load",
    "uniform_load": "line_load", "distributed_moment": "line_load", "connect": "join", "joint": "join", "hinge": "pin",
    "spherical": "ball", "cylinder": "cylindrical", "body": "link",
    "beam": "leaf", "flexure": "leaf", "temperature": "heat", "dashpot": "damper", "measure": "sensor", "probe": "sensor",
    "limit": "stop", "end_stop": "stop", "tendon": "cable", "rope": "cable",
}  # fmt: skip
"""Other words for methods of a mechanism."""


@clear_argument_errors_of_methods
class Mechanism(NotebookTables, metaclass=ClearArgumentErrors):
    """A mechanism under construction: links, joints between them, drives, supports and loads.

    All positions [m] and directions are global, in the undeformed configuration, where every link is at zero
    displacement and parallel to the global axes. Each method checks its arguments at once and raises SceneError;
    `validate` checks the whole mechanism and `scene` freezes it. Links are given as the objects made by `link`, or by name.
    name: of the mechanism. simulation: words of `ksd.simulate` that it takes where they are not given, None or a
    `ksd.Simulation`. report: what `ksd sweep` and `ksd report` ask about, None or a mapping of words of `ksd.sweep`,
    {"link": "table", "at": (0, 0.08, 0), "along": "x", "freed": ["push"]}, of links and drives that are there.
    plane: "xy", "xz" or "yz" for a planar mechanism: displacements normal to the plane and rotations out of it are fixed,
    pins turn about its normal, and leaf springs have their width along it.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> guide = ksd.Mechanism("guide")
    >>> table, sheet = guide.link("table"), ksd.rectangle(0.3 * mm, 20 * mm)
    >>> for x in (-30 * mm, 30 * mm):
    ...     leaf = guide.leaf(
    ...         "ground", table, start=(x, 0, 0), end=(x, 60 * mm, 0), width_axis="z",
    ...         section=sheet, material=steel,
    ...     )
    >>> drive = guide.actuate(table, along="x", at=(0, 30 * mm, 0), name="push")
    >>> pose = ksd.solve(guide, push=5 * mm)
    >>> print(f"{pose.forces['push']:.3f} N")
    5.036 N
    """

    name: str
    plane: str | None
    simulation: Simulation | None
    report: Mapping[str, Any] | None
    ground: Link
    _links: dict[str, Link]
    _hinges: dict[str, tuple[Hinge, tuple[Drive, ...]]]
    _masses: list[PointMass]
    _compliances: dict[str, Compliance]
    _gravity: Vector | None
    _points: list[LeafPoint]
    _joints: list[PlacedJoint]
    _leaves: list[PlacedLeaf]
    _drives: list[Drive]
    _supports: list[Drive]
    _loads: list[Load]
    _line_loads: list[LineLoad | Pressure]
    _springs: list[Spring | TurnSpring]
    _heats: list[Heat]
    _fits: list[Fit]
    _consider: tuple[str, ...]
    _distances: list[Distance]
    _sensors: list[Sensor]
    _dampers: list[Damper]
    _stops: list[Stop]
    _cables: list[Cable]
    _surfaces: list[Surface]
    _contacts: list[Contact]
    _last: tuple[Scene, dict[str, Any]] | None

    def __init__(self, name: str = "mechanism", *, plane: str | None = None) -> None:
        ground = Link(GROUND, self)
        # directly, without the checks of __setattr__: a design loop makes one for every design
        self.__dict__.update(
            ground=ground, _links={GROUND: ground}, _hinges={}, _masses=[], _compliances={}, _gravity=None, _points=[],
            _joints=[], _leaves=[], _drives=[], _supports=[], _loads=[], _line_loads=[], _springs=[], _heats=[], _fits=[],
            _consider=(), _distances=[], _sensors=[], _dampers=[], _stops=[], _cables=[], _surfaces=[], _contacts=[],
            _last=None, simulation=None, report=None,
        )  # fmt: skip
        self.name, self.plane = name, plane

    @classmethod
    def of_joint(cls, joint: Joint) -> Self:
        """`joint` alone, in its joint axes, from the ground to the link "B", each intended motion driven by its name.

        Raises SceneError for what is no joint.
        """
        mechanism = cls(getattr(joint, "family", "joint"))
        tip = mechanism.link("B")
        place: dict[str, Any] = {"at": (0, 0, 0), "axis": "z", "toward": "x", "name": "joint"}
        if isinstance(joint, Joint) and not joint.motions:
            mechanism.constrain(mechanism.ground, tip, joint, **place)
            return mechanism
        placed = mechanism.join(mechanism.ground, tip, joint, **place)
        for motion in joint.motions:
            mechanism.actuate_joint(placed, name=motion.name, motion=motion.name)
        return mechanism

    def __setattr__(self, name: str, value: Any) -> None:
        # a misspelt attribute would be accepted, and the scene solved without it
        if not name.startswith("_") and name not in SETTABLE_ATTRIBUTES:
            raise SceneError(f"a mechanism has no '{name}' to be set{name_hint(name, SETTABLE_ATTRIBUTES)}")
        if name == "simulation" and not isinstance(value, Simulation | None):
            raise SceneError(
                f"simulation = {show(value)}: give ksd.Simulation(until=...), or the words to ksd.simulate"
            )
        if name == "report" and value is not None:
            value = self._checked_report(value)
        if name == "plane":
            value = check_plane(value)
            for kind, drives in (("drive", self._drives), ("support", self._supports)):
                drives[:] = [check_drive_in_plane(drive, value, kind) for drive in drives]
            for kind, words in (("sensor", self._sensors), ("damper", self._dampers)):
                for said in words:
                    check_drive_in_plane(Drive(said.name, (said.term,)), value, kind)
            for stop in self._stops:
                check_drive_in_plane(Drive(stop.name, stop.terms), value, "stop")
            hinges = {n: check_hinge_in_plane(h, value) for n, (h, _) in self._hinges.items()}
            self._hinges = {n: (h, h.supports(value)) for n, h in hinges.items()}
        super().__setattr__(name, word(value, "name", owner="Mechanism") if name == "name" else value)

    if not TYPE_CHECKING:  # hidden, or checkers would take every name

        def __getattr__(self, name):
            # called for a property that raises, too
            if name.startswith("_") or hasattr(type(self), name):
                raise AttributeError(name)
            hint = name_hint(name, (word for word in dir(self) if not word.startswith("_")))
            if name in FUNCTIONS_OF_KSD:
                hint = f"; ask it by ksd.{name}(mechanism, ...)."
            elif name in SYNONYMS:
                hint = f"; say mechanism.{SYNONYMS[name]}."
            raise UnknownWordError(f"a mechanism has no '{name}'{hint}")

    def __repr__(self) -> str:
        return (
            f"Mechanism('{self.name}': {len(self._links) - 1} links, {len(self._joints)} joints, "
            f"{len(self._leaves)} leaf springs, {len(self._drives)} drives)"
        )

    def __str__(self) -> str:
        """The parts described so far, one per line."""
        return str(self.draft())

    # Links

    @property
    def gravity(self) -> Vector | None:
        """Gravitational acceleration (3,) [m/s^2], e.g. (0, -9.81, 0); None when the scene does not mention gravity.

        It acts on the masses of links, and along every leaf whose material has a density.
        """
        return self._gravity

    @gravity.setter
    def gravity(self, value: ArrayLike | None) -> None:
        self._gravity = None if value is None else vector(value, "gravity", owner=self.name, unit="m/s^2")

    def link(
        self,
        name: str,
        *,
        mass: float | None = None,
        inertia: ArrayLike | None = None,
        at: ArrayLike | None = None,
        section: Section | None = None,
        material: Material | None = None,
    ) -> Link:
        """Add a link of this name; mass [kg], inertia [kg m^2] and the centre of mass `at` [m] as in `mass`.

        It is rigid unless section and material are given; then it is elastic as described in `compliance`. Raises
        SceneError.
        """
        word(name, "link name", owner=self.name)
        if name in self._links:
            raise SceneError(f"link '{name}' exists already; every link needs its own name.")
        if mass is None and inertia is not None:
            raise SceneError(f"link '{name}': inertia is given without mass; give both.")
        added = self._links[name] = Link(name, self)
        try:
            if section is not None or material is not None:
                self.compliance(added, section=section, material=material)
            if mass is not None:
                self.mass(added, mass=mass, inertia=inertia, at=at)
        except SceneError:
            # a refused statement must leave the mechanism as it was
            del self._links[name]
            self._compliances.pop(name, None)
            raise
        return added

    def links(self, *names: str) -> tuple[Link, ...]:
        """Add links, one per name."""
        return tuple(self.link(name) for name in names)

    def _checked_link(self, link: Link | str, owner: str) -> str:
        """The name of a link of this mechanism; `owner` starts messages. Raises SceneError."""
        if isinstance(link, Link):
            if link.owner is not self:
                raise SceneError(
                    f"{owner}: link '{link.name}' belongs to another mechanism, '{link.owner.name}'."
                )
            return link.name
        if not isinstance(link, str):
            raise SceneError(
                f"{owner}: {show(link)} is not a link; give a link of the mechanism or its name."
            )
        if link not in self._links:
            raise UnknownNameError(
                f"{owner}: link '{link}' does not exist{name_hint(link, self._links)}", kind="link", name=link
            )
        return link

    def _checked_report(self, words: Any) -> dict[str, Any]:
        """The words of `report`, SI. Raises SceneError."""
        if not isinstance(words, Mapping):
            raise SceneError(
                f"report = {show(words)}: give a mapping, such as {{'link': 'table', 'at': (0, 0.08, 0)}}"
            )
        for key in words:
            if key not in REPORT_WORDS:
                raise SceneError(f"report: key '{key}' is unknown{name_hint(str(key), REPORT_WORDS)}")
        checked = dict(words)
        if "link" in words:
            checked["link"] = self._checked_link(words["link"], "report")
        if "at" in words:
            checked["at"] = vector(words["at"], "at", owner="report", unit="m")
        if "along" in words:
            checked["along"] = direction(words["along"], "along", owner="report")
        if "freed" in words:
            checked["freed"] = names_of(words["freed"], "report: freed")
            known = [drive.name for drive in (*self._drives, *self._supports)]
            for name in checked["freed"]:
                if name not in known:
                    raise UnknownNameError(
                        f"report: freed = '{name}': there is no drive or support of that name{name_hint(name, known)}",
                        kind="drive",
                        name=name,
                    )
        return checked

    def _position_or_default(self, link: str, at: ArrayLike | None) -> Any:
        """The position `at` as given; None gives the position of a link that is a point of a leaf, else None."""
        return self._links[link].at if at is None else as_given(at)

    def _link_pair(self, a: Link | str, b: Link | str, owner: str) -> tuple[str, str]:
        """The names of two different links; `owner` starts messages. Raises SceneError."""
        first, second = self._checked_link(a, owner), self._checked_link(b, owner)
        if first == second:
            raise SceneError(f"{owner} connects link '{first}' with itself; it needs two different links.")
        return first, second

    def mass(
        self, link: Link | str, *, mass: float, inertia: ArrayLike | None = None, at: ArrayLike | None = None
    ) -> PointMass:
        """Add a rigid mass [kg] to a link: centre `at` (3,) [m], inertia (3,) or (3, 3) [kg m^2] about it, in global axes.

        Raises SceneError.
        """
        name = self._checked_link(link, "mass")
        centre = self._position_or_default(name, at)
        if centre is None:
            raise SceneError(f"mass on '{name}': 'at' is missing; give its centre (x, y, z) in m.")
        added = PointMass(name, mass, as_given(inertia), centre)
        self._masses.append(added)
        return added

    def compliance(
        self,
        link: Link | str,
        *,
        section: Section | None = None,
        material: Material | None = None,
        hub: ArrayLike | None = None,
        width_axis: Axis | None = None,
        matrix: LinkMatrix | str | os.PathLike[str] | None = None,
    ) -> Compliance:
        """Make a link elastic, by a section and material or by a Craig-Bampton matrix.

        With a section it consists of beams from its hub (3,) [m] (the mean of its attachments when left out) to every joint
        and leaf on it; loads, drives, masses and springs of the link act on the hub. width_axis: direction of the section's
        width, that of the axis of the first joint on the link when left out. With a matrix, a `LinkMatrix` or the path of a
        file for `link_matrix`, the link has two interfaces; joints and leaf springs attach to the interface at their
        position, and loads, drives, masses and springs act on the first. Raises SceneError.
        """
        name = self._checked_link(link, "compliance")
        if name == self.ground.name:
            raise SceneError("compliance: the ground cannot be elastic; put a link and leaf springs between.")
        if name in self._compliances:
            raise SceneError(f"compliance of link '{name}' is given twice; keep one.")
        if isinstance(matrix, str | os.PathLike):
            matrix = link_matrix(matrix)
        added = Compliance(name, section, material, as_given(hub), as_given(width_axis), matrix)
        self._compliances[name] = added
        return added

    # Elastic connections

    def _new_name(self, name: str | None, default: str, more: Set[str] = frozenset()) -> str:
        """A name that no joint or leaf has yet and that is not in `more`. Raises SceneError."""
        used = {j.name for j in self._joints} | {leaf.name for leaf in self._leaves} | more
        return _free_name(name, default, used, self.name, each="joint and leaf")

    def join(
        self,
        a: Link | str,
        b: Link | str,
        joint: Joint,
        *,
        at: ArrayLike,
        axis: Axis,
        toward: Axis,
        name: str | None = None,
    ) -> PlacedJoint:
        """Connect link `a` (interface A) with link `b` (interface B) by a joint.

        at (3,) [m]: position of interface A; axis: direction of the joint's z, its intended axis; toward: direction from
        A to B, perpendicular to axis; both "x", "-y" or three numbers. The joint's y, along which a guide moves, is axis x
        toward: with axis "z" it is "y" for toward "x", and "-x" for toward "y". Interface B is at `at` + length_AB * toward
        for joints drawn with B on their x axis. The default name is "a-b". Raises SceneError.
        """
        if isinstance(joint, Joint) and not joint.motions:
            raise SceneError(
                f"a {joint.family} has no intended motion; say mechanism.constrain instead of join."
            )
        placed = self._place_joint("joint", a, b, joint, at=at, axis=axis, toward=toward, name=name)
        self._joints.append(placed)
        return placed

    def _place_joint(
        self, kind: str, a: Any, b: Any, joint: Any, *, at: Any, axis: Any, toward: Any, name: str | None
    ) -> PlacedJoint:
        """A joint placed between links a and b, see `join`; kind: its word in messages. Raises SceneError."""
        # leaf springs of a constraint are called "name/leaf"
        constraints = {leaf.name.rpartition("/")[0] for leaf in self._leaves}
        label = self._new_name(name, f"{link_name(a)}-{link_name(b)}", constraints)
        owner = f"{kind} '{label}'"
        first, second = self._link_pair(a, b, owner)
        if not isinstance(joint, Joint):
            given = getattr(joint, "__name__", None) or show(joint)
            raise SceneError(f"{owner}: {given} is not a joint; make one, e.g. ksd.CrossFlexure(...).")
        origin = vector(at, "at", owner=owner, unit="m")
        return PlacedJoint(label, first, second, joint, origin, joint_rotation(axis, toward, owner))

    def constrain(
        self,
        a: Link | str,
        b: Link | str,
        joint: Joint,
        *,
        at: ArrayLike,
        axis: Axis,
        toward: Axis,
        name: str | None = None,
    ) -> tuple[PlacedLeaf, ...]:
        """Add the leaf springs of `joint` between two links as a flexible constraint; at, axis, toward as in `join`.

        Its internal blocks become links "name/block" and its leaf springs free-form leaf springs "name/leaf", all modelled
        in full and without a record. Meant for joints without intended motion, such as `FoldedLeaf`; any joint is accepted.
        Raises SceneError.
        """
        placed = self._place_joint("constraint", a, b, joint, at=at, axis=axis, toward=toward, name=name)
        links = {"A": placed.a, "B": placed.b}
        for block in joint.blocks():
            if block not in links:
                links[block] = self.link(f"{placed.name}/{block}").name
        leaves = tuple(global_leaf(placed, leaf, links) for leaf in joint.leaves())
        self._leaves += leaves
        return leaves

    def leaf(
        self,
        a: Link | str,
        b: Link | str,
        *,
        start: ArrayLike,
        end: ArrayLike,
        section: Section,
        material: Material,
        width_axis: Axis | None = None,
        name: str | None = None,
        elements: int | None = None,
        orders: tuple[int, int, int] | None = None,
        profile: Profile | None = None,
        curve: Curve | None = None,
    ) -> PlacedLeaf:
        """Add a free-form leaf clamped to link `a` at `start` (3,) [m] and to `b` at `end`; other parameters as in `Leaf`.

        Both may be the same link, as for a string of a bow or a membrane; a `point` on it then carries what acts on it, and
        without one the model puts the point "NAME middle" on it.
        The default width_axis is the normal of the plane of the mechanism, if it has one. Raises SceneError.
        """
        label = self._new_name(name, "leaf")
        first, second = (self._checked_link(link, f"leaf '{label}'") for link in (a, b))
        if width_axis is None and self.plane is not None:
            width_axis = plane_normal(self.plane)
            ends = (
                vector(start, "start", owner=f"leaf '{label}'"),
                vector(end, "end", owner=f"leaf '{label}'"),
            )
            normal_distance = sum(n * (b - a) for n, a, b in zip(width_axis, *ends, strict=True))
            if abs(normal_distance) > PERPENDICULAR * math.dist(*ends):
                raise SceneError(
                    f"leaf '{label}' leaves the plane {self.plane}: its ends are "
                    f"{1e3 * abs(normal_distance):.4g} mm apart along its normal; put both in it, or say width_axis."
                )
        made = Leaf(
            start=as_given(start),
            end=as_given(end),
            width_axis=as_given(width_axis),
            section=section,
            material=material,
            start_block=first,
            end_block=second,
            name=label,
            elements=elements,
            orders=orders,
            profile=profile,
            curve=curve,
        )
        self._leaves.append(PlacedLeaf(label, first, second, made))
        return self._leaves[-1]

    def wire(
        self,
        a: Link | str,
        b: Link | str,
        *,
        start: ArrayLike,
        end: ArrayLike,
        diameter: float,
        material: Material,
        width_axis: Axis | None = None,
        name: str | None = None,
        elements: int | None = None,
        orders: tuple[int, int, int] | None = None,
        profile: Profile | None = None,
        curve: Curve | None = None,
    ) -> PlacedLeaf:
        """Add a round wire of `diameter` [m] from link `a` to link `b`; other parameters as in `leaf`. Raises SceneError."""
        label = self._new_name(name, "wire")
        first, second = (self._checked_link(link, f"wire '{label}'") for link in (a, b))
        made = make_wire(
            diameter=diameter, material=material, start=start, end=end, width_axis=width_axis, start_block=first,
            end_block=second, name=label, elements=elements, orders=orders, profile=profile, curve=curve,
        )  # fmt: skip
        self._leaves.append(PlacedLeaf(label, first, second, made))
        return self._leaves[-1]

    def point(self, leaf: PlacedLeaf | str, s: float, *, name: str | None = None) -> Link:
        """Add the point of a free-form leaf at arc length s [m] from its start as a link without mass, clamped there.

        It can be loaded, driven, supported, given a mass and pinned like any link; its position is the default of `at`. The
        leaf remains one leaf in stresses, pictures and names. The default name is "leaf point 1". Raises SceneError.
        """
        placed = self._free_leaf(leaf, "point")
        label = placed.name
        length, at = placed.leaf.length, number(s, "s", owner=f"point of leaf '{label}'", unit="m")
        if not 1e-9 * length < at < (1 - 1e-9) * length:
            raise SceneError(
                f"point of leaf '{label}': s = {at:g} m is not between its ends; the leaf is {length:g} m long, "
                f"give 0 < s < {length:g}, or name link '{placed.a if at <= 0.5 * length else placed.b}' for its end."
            )
        for other in self._points:
            if other.leaf == label and abs(other.s - at) <= 1e-9 * length:
                raise SceneError(
                    f"point of leaf '{label}': '{other.name}' is at s = {at:g} m already; use it."
                )
        # numbered, not named by s, which a design may vary
        count = 1 + sum(other.leaf == label for other in self._points)
        default = unused_name(f"{label} point {count}", set(self._links))
        added = LeafPoint(default if name is None else name, label, at)
        position, _ = placed.leaf.section_at(at / length)
        self.link(added.name)
        self._points.append(added)
        link = self._links[added.name] = replace(self._links[added.name], at=tuple(position.tolist()))
        return link

    def _free_leaf(self, leaf: Any, owner: str) -> PlacedLeaf:
        """The free-form leaf of this name, or what `leaf` or `wire` returned. Raises UnknownNameError."""
        label = leaf.name if isinstance(leaf, PlacedLeaf | Link) else leaf
        placed = next((f for f in self._leaves if f.name == label), None)
        if placed is None:
            known = [f.name for f in self._leaves]
            hint = name_hint(label, known) if isinstance(label, str) else ""
            what = (
                f"'{label}' is a link"
                if label in self._links
                else f"there is no free-form leaf {show(label)}"
            )
            raise UnknownNameError(
                f"{owner}: {what} (leaf springs of a joint are free-form by mechanism.constrain){hint}",
                kind="leaf",
                name=str(label),
            )
        return placed

    # Hinges

    def pin(
        self,
        a: Link | str,
        b: Link | str,
        *,
        at: ArrayLike | None = None,
        axis: Axis | None = None,
        name: str | None = None,
    ) -> Hinge:
        """Add a pin: link `b` turns on link `a` about `axis` through `at` (3,) [m], without stiffness.

        axis: default is the normal of the plane of the mechanism; at: default is the position of a link that is a point of a
        leaf. Its forces are in `reactions` as "name.x", "name.y", in the axes of `a`, and in global axes in
        `interface_forces`. The default name is "a-b". Raises SceneError.
        """
        if axis is None and self.plane is None:
            raise SceneError(
                "a pin needs its axis: give axis=, or say the plane of the mechanism, "
                f'ksd.Mechanism("{self.name}", plane="xy").'
            )
        return self._add_hinge("pin", a, b, at, plane_normal(str(self.plane)) if axis is None else axis, name)

    def slider(
        self,
        link: Link | str,
        *,
        along: Axis,
        at: ArrayLike | None = None,
        relative_to: Link | str | None = None,
        name: str | None = None,
    ) -> Hinge:
        """Add a slider: a link slides `along` a direction of ground, or of `relative_to`, without stiffness and rotation.

        at (3,) [m]: the point where pictures show it and to which its force refers. The default name is "a-link". Raises
        SceneError.
        """
        return self._add_hinge(
            "slider", GROUND if relative_to is None else relative_to, link, at, along, name
        )

    def ball(
        self, a: Link | str, b: Link | str, *, at: ArrayLike | None = None, name: str | None = None
    ) -> Hinge:
        """Add a ball joint: link `b` turns on link `a` about the point `at` (3,) [m] in any direction, without stiffness.

        at: default is the position of a link that is a point of a leaf. Its force is in `reactions` as "name.x", "name.y",
        "name.z", in the axes of `a`, and in global axes in `interface_forces`. A rod between two of them can spin about its
        own axis: support that rotation, or give it a pin at one end. The default name is "a-b". Raises SceneError.
        """
        return self._add_hinge("ball", a, b, at, "z", name)

    def cylindrical(
        self,
        a: Link | str,
        b: Link | str,
        *,
        axis: Axis,
        at: ArrayLike | None = None,
        name: str | None = None,
    ) -> Hinge:
        """Add a cylindrical hinge: link `b` turns about `axis` through `at` (3,) [m] of `a` and slides along it, freely.

        Its forces and moments are in `reactions` as those of a pin, but for the force along the axis. The default name is
        "a-b". Raises SceneError.
        """
        return self._add_hinge("cylindrical", a, b, at, axis, name)

    def _add_hinge(self, kind: str, a: Any, b: Any, at: Any, axis: Any, name: str | None) -> Hinge:
        """Add a hinge of link b on link a, see `ksd.scene.hinges.Hinge`. Raises SceneError."""
        used = {*self._hinges, *(d.name for d in (*self._drives, *self._supports))}
        default = f"{link_name(a)}-{link_name(b)}"
        label = _free_name(name, default, used, kind, each="hinge")
        owner = f"{kind} '{label}'"
        first, second = self._link_pair(a, b, owner)
        leaf_points = {n: p for n in (first, second) if (p := self._links[n].at) is not None}
        position = next(iter(leaf_points.values()), None) if at is None else as_given(at)
        if position is None:
            raise SceneError(f"{owner}: 'at' is missing; give the point (x, y, z) in m where it is.")
        added = check_hinge_in_plane(Hinge(label, kind, first, second, position, as_given(axis)), self.plane)
        tolerance = 1e-6 * max((f.leaf.length for f in self._leaves), default=0.0)
        apart = math.dist(*leaf_points.values()) if len(leaf_points) == 2 else 0.0
        for point, point_at in leaf_points.items():
            distance = math.dist(point_at, added.at)
            if kind in ("pin", "ball") and distance > tolerance:
                remedy = f"give at={show(point_at)}"
                if apart > tolerance:
                    remedy = (
                        "give both points an s at which their leaf springs meet, or put a link between them"
                    )
                raise SceneError(
                    f"{owner}: '{first}' and '{second}' do not meet: '{point}' is at {show(point_at)} m, "
                    f"{1e3 * distance:.4g} mm from {show(added.at)}; {remedy}."
                )
        self._hinges[label] = added, added.supports(self.plane)
        return added

    # Drives and supports

    def displacement(
        self,
        link: Link | str,
        along: Axis,
        *,
        at: ArrayLike,
        relative_to: Link | str | None = None,
        coefficient: float = 1.0,
    ) -> DriveTerm:
        """Drive term: displacement [m] of point `at` (3,) [m] of a link along a direction, times `coefficient`.

        It is relative to ground or to the link `relative_to`. Raises SceneError for unknown links and directions.
        """
        return self._term(link, along, "translation", at, relative_to) * coefficient

    def rotation(
        self,
        link: Link | str,
        about: Axis,
        *,
        at: ArrayLike = (0.0, 0.0, 0.0),
        relative_to: Link | str | None = None,
        coefficient: float = 1.0,
    ) -> DriveTerm:
        """Drive term: rotation [rad] of a link about a direction, times `coefficient`.

        It is relative to ground or to the link `relative_to`; at (3,) [m]: the point where pictures show it. Raises
        SceneError for unknown links and directions.
        """
        return self._term(link, about, "rotation", at, relative_to) * coefficient

    def _term(
        self, link: Any, along: Any, kind: str, at: Any, relative_to: Any, owner: str = ""
    ) -> DriveTerm:
        """The drive term of `displacement` or `rotation` with coefficient 1; owner starts messages. Raises SceneError."""
        driven = "driven" if not owner else "measured"
        owner = owner or f"drive of '{link_name(link)}'"
        name = self._checked_link(link, owner)
        base = GROUND if relative_to is None else self._checked_link(relative_to, owner)
        if name == base:
            raise SceneError(f"{owner}: a link cannot be {driven} relative to itself; '{name}' is both.")
        at = self._position_or_default(name, at)
        if at is None:
            raise SceneError(
                f"{owner}: 'at' is missing; a displacement needs the point (x, y, z) that is {driven}."
            )
        axis = direction(along, "along" if kind == "translation" else "about", owner=owner)
        return DriveTerm(1.0, kind, base, name, axis, vector(at, "at", owner=owner, unit="m"))

    def actuate(
        self,
        link: Link | str | None = None,
        *,
        along: Axis | None = None,
        about: Axis | None = None,
        at: ArrayLike | None = None,
        relative_to: Link | str | None = None,
        name: str | None = None,
        joint: PlacedJoint | str | None = None,
        motion: str | None = None,
        terms: Sequence[DriveTerm] | DriveTerm | None = None,
    ) -> Drive:
        """Prescribe a component of motion; its value is given when solving, and is zero in the undeformed configuration.

        Give one of: `link` with `along` and the point `at` (3,) [m], for the displacement of that point [m]; `link` with
        `about`, for a rotation [rad]; `joint`, for its intended motion, or the one named `motion` of several; `terms`, for a
        sum of `displacement` and `rotation` terms. The direction is fixed in ground or in `relative_to`. The default name is
        that of the link or joint, or "link.x", "link.rz" when that is used already. Raises SceneError.
        """
        component = {"along": along, "about": about, "at": at, "relative_to": relative_to}
        parts, default = self._drive_terms(link, **component, joint=joint, motion=motion, terms=terms)
        drive = check_drive_in_plane(Drive(self._drive_name(name, default, parts), parts), self.plane)
        self._drives.append(drive)
        return drive

    def actuate_joint(
        self, joint: PlacedJoint | str, name: str | None = None, *, motion: str | None = None
    ) -> Drive:
        """Prescribe an intended motion of a joint, or the one named `motion` of several: b relative to a, axis fixed in a.

        The docstring of the joint describes the point of B that a translation refers to. Raises SceneError.
        """
        return self.actuate(joint=joint, motion=motion, name=name)

    def support(
        self,
        link: Link | str | None = None,
        *,
        along: Axis | None = None,
        about: Axis | None = None,
        at: ArrayLike | None = None,
        relative_to: Link | str | None = None,
        name: str | None = None,
        joint: PlacedJoint | str | None = None,
        motion: str | None = None,
        terms: Sequence[DriveTerm] | DriveTerm | None = None,
    ) -> Drive:
        """Fix a component of motion at zero; the component is given as in `actuate`.

        The force of the support is in `Configuration.reactions`. Raises SceneError.
        """
        component = {"along": along, "about": about, "at": at, "relative_to": relative_to}
        parts, default = self._drive_terms(link, **component, joint=joint, motion=motion, terms=terms)
        support = check_drive_in_plane(
            Drive(self._drive_name(name, f"{default}.held", parts), parts), self.plane, "support"
        )
        self._supports.append(support)
        return support

    def _drive_terms(
        self,
        link: Any,
        *,
        along: Any = None,
        about: Any = None,
        at: Any = None,
        relative_to: Any = None,
        joint: Any = None,
        motion: Any = None,
        terms: Any = None,
    ) -> tuple[tuple[DriveTerm, ...], str]:
        """The terms of a drive or support and its default name, from the arguments of `actuate`. Raises SceneError."""
        names = [k for k, v in {"link": link, "joint": joint, "terms": terms}.items() if v is not None]
        if len(names) != 1:
            given = " and ".join(names) or "nothing"
            raise SceneError(f"a drive needs exactly one of link, joint and terms, but {given} is given.")
        if terms is not None:
            return self._checked_terms(terms)
        if joint is not None:
            placed = self._find_joint(joint)
            kind, axis, point = joint_angle(placed, placed.joint.motion(motion))
            return (DriveTerm(1.0, kind, placed.a, placed.b, axis, point),), placed.name
        return (self._component(link, along, about, at, relative_to),), link_name(link)

    def _component(
        self, link: Any, along: Any, about: Any, at: Any, relative_to: Any, owner: str = ""
    ) -> DriveTerm:
        """The displacement along, or the rotation about a direction, whichever is given. Raises SceneError."""
        if (along is None) == (about is None):
            who = owner or f"drive of '{link_name(link)}'"
            raise SceneError(
                f"{who}: give one of along=direction (a displacement) and about=axis (a rotation)."
            )
        if along is not None:
            return self._term(link, along, "translation", at, relative_to, owner)
        return self._term(link, about, "rotation", (0.0, 0.0, 0.0) if at is None else at, relative_to, owner)

    def _checked_terms(self, terms: Any) -> tuple[tuple[DriveTerm, ...], str]:
        """Terms given by the user as a tuple, and the name of the first link. Raises SceneError."""
        parts = (terms,) if isinstance(terms, DriveTerm) else terms
        if not isinstance(parts, Iterable):
            raise SceneError(f"terms = {show(terms)}: add up mechanism.displacement and mechanism.rotation.")
        parts = tuple(parts)
        drive = Drive("terms", parts)
        for term in drive.terms:
            self._checked_link(term.base, "drive term")
            self._checked_link(term.link, "drive term")
        return drive.terms, drive.terms[0].link

    def _find_joint(self, joint: PlacedJoint | str) -> PlacedJoint:
        """The placed joint of this name. Raises SceneError."""
        name = joint.name if isinstance(joint, PlacedJoint) else joint
        for placed in self._joints:
            if isinstance(name, str) and placed.name == name:
                return placed
        if not isinstance(name, str):
            raise SceneError(f"{_no_placed_joint_message(joint)}.")
        raise UnknownNameError(
            f"joint {show(name)} does not exist{name_hint(name, [j.name for j in self._joints])}",
            kind="joint",
            name=str(name),
        )

    def _drive_name(self, name: str | None, default: str, parts: tuple[DriveTerm, ...]) -> str:
        """A name that no drive or support has yet; a used default gets the suffix of its direction. Raises SceneError."""
        used = {d.name for d in (*self._drives, *self._supports)} | {cable.name for cable in self._cables}
        used |= {d.name for _, supports in self._hinges.values() for d in supports}
        suffix = direction_suffix(parts[0]) if default in used and len(parts) == 1 else ""
        return _free_name(name, f"{default}.{suffix}" if suffix else default, used, "drive")

    # Loads

    def load(
        self,
        link: Link | str,
        *,
        force: ArrayLike | None = None,
        moment: ArrayLike | None = None,
        at: ArrayLike | None = None,
        following: bool = False,
        name: str | None = None,
    ) -> Load:
        """Load a link: force (3,) [N] at the point `at` (3,) [m], moment (3,) [Nm], in global axes.

        following=True: both turn with the link (follower loads). The default name is "link.load". Raises SceneError.
        """
        used = {x.name for x in self._loads} | {x.name for x in self._line_loads}
        label = _free_name(name, f"{link_name(link)}.load", used, "load")
        owner = f"load '{label}'"
        known = self._checked_link(link, owner)
        if force is None and moment is None:
            raise SceneError(f"{owner}: give force, moment, or both.")
        at = self._position_or_default(known, at)
        if force is not None and at is None:
            raise SceneError(f"{owner}: 'at' is missing; a force needs the point (x, y, z) it acts on.")
        zero = (0.0, 0.0, 0.0)
        added = Load(
            label,
            known,
            zero if force is None else as_given(force),
            zero if moment is None else as_given(moment),
            zero if at is None else as_given(at),
            following,
        )
        self._loads.append(added)
        return added

    def line_load(
        self,
        leaf: PlacedLeaf | str,
        *,
        force: ArrayLike | None = None,
        moment: ArrayLike | None = None,
        to: ArrayLike | None = None,
        to_moment: ArrayLike | None = None,
        start: float = 0.0,
        end: float | None = None,
        name: str | None = None,
    ) -> LineLoad:
        """Load a free-form leaf along its length: `force` (3,) [N/m] and `moment` (3,) [Nm/m] per undeformed length, in
        global axes, which keep their direction.

        to (3,) [N/m], to_moment (3,) [Nm/m]: force and moment per length at `end`, linear from `force` and `moment` at
        `start`; None: these all along. start, end [m]: arc lengths from the start of the leaf between which it acts, by
        default all of it. The default name is "leaf.line_load". Example: mechanism.line_load(beam, force=(0, -2.0, 0),
        end=0.04). Raises SceneError.
        """
        placed, label = self._place_of_load(leaf, "line_load", name)
        owner = f"line load '{label}'"
        if force is None and moment is None:
            raise SceneError(f"{owner}: give force, moment, or both.")
        for key, last, first in (("to", to, force), ("to_moment", to_moment, moment)):
            if last is not None and first is None:
                known = "force" if key == "to" else "moment"
                raise SceneError(
                    f"{owner}: {key} = {show(last)} is its {known} at the end; give {known} too."
                )
        zero = (0.0, 0.0, 0.0)
        added = LineLoad(
            label,
            placed.name,
            zero if force is None else as_given(force),
            None if to is None else as_given(to),
            start,
            end,
            zero if moment is None else as_given(moment),
            None if to_moment is None else as_given(to_moment),
        )
        self._check_span(placed, added, owner)
        self._line_loads.append(added)
        return added

    def pressure(
        self,
        leaf: PlacedLeaf | str,
        pressure: float,
        *,
        side: str = "+e2",
        start: float = 0.0,
        end: float | None = None,
        name: str | None = None,
    ) -> Pressure:
        """Press on a face of a free-form leaf: `pressure` [Pa] over its width, normal to it in every state.

        side: the direction of the push, "+e2" or "-e2"; e2 is the direction from the start of the leaf to its end, turned
        left about its width axis. start, end [m]: as of `line_load`. The default name is "leaf.pressure". Raises SceneError.
        """
        placed, label = self._place_of_load(leaf, "pressure", name)
        owner = f"pressure '{label}'"
        if round_ratio(placed.leaf.section) is not None:
            raise SceneError(
                f"{owner}: '{placed.name}' has a round section, which has no face; give a line load, or a leaf of a "
                "rectangular section."
            )
        if not placed.leaf.section.width > 0.0:
            raise SceneError(
                f"{owner}: the section of leaf '{placed.name}' has no width, so it has no face; give ksd.Section its width."
            )
        added = Pressure(label, placed.name, pressure, side, start, end)
        self._check_span(placed, added, owner)
        self._line_loads.append(added)
        return added

    def _place_of_load(self, leaf: Any, kind: str, name: str | None) -> tuple[PlacedLeaf, str]:
        """The leaf of a load along it, and the name of the load."""
        placed = self._free_leaf(leaf, kind.replace("_", " "))
        used = {x.name for x in self._loads} | {x.name for x in self._line_loads}
        return placed, _free_name(name, f"{placed.name}.{kind}", used, "load")

    @staticmethod
    def _check_span(placed: PlacedLeaf, load: LineLoad | Pressure, owner: str) -> None:
        """Raise SceneError for a load that goes on beyond its leaf."""
        length = placed.leaf.length
        last = load.start if load.end is None else load.end
        if last > length * (1.0 + 1e-9) or (load.end is None and not load.start < length):
            key = "start" if load.end is None else "end"
            raise SceneError(
                f"{owner}: {key} = {last:g} m is beyond the end of leaf '{placed.name}', which is {length:g} m long; "
                "give at most that, or leave it out."
            )

    # Optional effects, see `ksd.scene.effects`

    def spring(
        self,
        a: Link | str,
        b: Link | str,
        *,
        start: ArrayLike,
        end: ArrayLike,
        stiffness: float,
        free_length: float | None = None,
        name: str | None = None,
    ) -> Spring:
        """Add a coil spring of stiffness [N/m] from `start` (3,) [m] on link `a` to `end` on `b`.

        free_length [m]: its length without force; default is the undeformed distance between its ends, 0 is the
        zero-free-length spring of static balancing. Raises SceneError.
        """
        label = self._spring_name(name, "spring")
        first, second = self._link_pair(a, b, f"spring '{label}'")
        ends = [
            vector(p, w, owner=f"spring '{label}'", unit="m") for p, w in ((start, "start"), (end, "end"))
        ]
        length = math.dist(*ends) if free_length is None else free_length
        added = Spring(label, first, second, ends[0], ends[1], stiffness, length)
        self._springs.append(added)
        return added

    def damper(
        self,
        a: Link | str,
        b: Link | str,
        *,
        damping: float,
        along: Axis | None = None,
        about: Axis | None = None,
        at: ArrayLike | None = None,
        name: str | None = None,
    ) -> Damper:
        """Add a dashpot between two links: a force of `damping` [N s/m] times the speed of point `at` (3,) [m] of `b` along
        a direction fixed in `a`, or with about= a moment of `damping` [Nm s/rad] times the rate of rotation.

        It resists motion only: answers about vibrations have it, static ones do not. The default name is "damper". Raises
        SceneError.
        """
        label = _free_name(name, "damper", {d.name for d in self._dampers}, "damper")
        owner = f"damper '{label}'"
        first, second = self._link_pair(a, b, owner)
        term = self._component(second, along, about, at, None if first == GROUND else first, owner)
        added = Damper(label, term, damping)
        check_drive_in_plane(Drive(label, (term,)), self.plane, "damper")
        self._dampers.append(added)
        return added

    def joint_spring(
        self,
        joint: PlacedJoint | str,
        *,
        stiffness: float,
        rest_angle: float = 0.0,
        motion: str | None = None,
        name: str | None = None,
    ) -> TurnSpring:
        """Add a torsion spring [Nm/rad] between the links of a joint, about the axis of its intended motion `motion`.

        motion: may be left out when the joint has one motion only. rest_angle [rad]: rotation of b relative to a without
        moment; a positive one turns b in the positive sense. Raises SceneError.
        """
        placed = self._find_joint(joint)
        turning = placed.joint.motion(motion)
        label = self._spring_name(name, f"{placed.name}.spring")
        if turning.kind != "rotation":
            raise SceneError(
                f"joint spring '{label}': motion '{turning.name}' of joint '{placed.name}' is a translation; "
                "put a coil spring (mechanism.spring) between its links."
            )
        axis = placed.turn(turning.axis)
        return self.turn_spring(
            placed.a,
            placed.b,
            at=placed.origin,
            axis=axis,
            stiffness=stiffness,
            rest_angle=rest_angle,
            name=label,
        )

    def turn_spring(
        self,
        a: Link | str,
        b: Link | str,
        *,
        at: ArrayLike,
        axis: Axis,
        stiffness: float,
        rest_angle: float = 0.0,
        name: str | None = None,
    ) -> TurnSpring:
        """Add a torsion spring of stiffness [Nm/rad] from link `a` to link `b` about `axis` through `at` (3,) [m].

        rest_angle [rad]: as in `joint_spring`. The default name is "torsion spring". Raises SceneError.
        """
        label = self._spring_name(name, "torsion spring")
        first, second = self._link_pair(a, b, f"spring '{label}'")
        added = TurnSpring(label, first, second, as_given(at), as_given(axis), stiffness, rest_angle)
        self._springs.append(added)
        return added

    def _spring_name(self, name: str | None, default: str) -> str:
        """A name that no spring has yet. Raises SceneError."""
        return _free_name(name, default, {s.name for s in self._springs}, "spring")

    def heat(
        self, temperature: float = 0.0, *, through: float = 0.0, leaves: str | Sequence[str] | None = None
    ) -> Heat:
        """Heat leaf springs by `temperature` [K], and by `through` [K] more at their +e2 face than at their -e2 face.

        leaves: full names ("joint/leaf"), default all; their material must have an expansion. Raises SceneError.
        """
        names = (leaves,) if isinstance(leaves, str) else leaves
        if names is not None and not isinstance(names, list | tuple):
            raise SceneError(f"heat: leaves = {show(leaves)} must be names of leaf springs in a list.")
        self._heats.append(Heat(temperature, through, None if names is None else tuple(names)))
        return self._heats[-1]

    def fit(
        self,
        leaf: PlacedLeaf | str,
        *,
        natural_length: float | None = None,
        shift: ArrayLike = (0.0, 0.0, 0.0),
        turn: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Fit:
        """Prestress a leaf by its natural_length [m], or misplace its clamp by an assembly error shift [m] and turn [rad].

        leaf: full name ("joint/leaf") or a free-form leaf; shift (3,) and turn (3,), a rotation vector: from the drawn pose
        of end q to the pose in which it is clamped, in the axes of the leaf at its start. Raises SceneError.
        """
        self._fits.append(
            Fit(str(getattr(leaf, "name", leaf)), natural_length, as_given(shift), as_given(turn))
        )
        return self._fits[-1]

    def consider(self, *effects: str) -> None:
        """Simulate optional effects of leaf springs: "warping" and "plate".

        Without this statement leaf springs are standard beams, as in the literature they are compared with. Raises
        SceneError.
        """
        for effect in effects:
            if effect not in OPTIONAL_EFFECTS:
                raise SceneError(f"consider: {show(effect)} is unknown{name_hint(effect, OPTIONAL_EFFECTS)}")
        self._consider = tuple(sorted({*self._consider, *effects}))

    # One-sided parts, see `ksd.scene.obstacle`

    def stop(
        self,
        link: Link | str | None = None,
        *,
        along: Axis | None = None,
        about: Axis | None = None,
        at: ArrayLike | None = None,
        relative_to: Link | str | None = None,
        low: float | None = None,
        high: float | None = None,
        softness: float = 0.0,
        name: str | None = None,
        joint: PlacedJoint | str | None = None,
        motion: str | None = None,
        terms: Sequence[DriveTerm] | DriveTerm | None = None,
    ) -> Stop:
        """End stops: a component of motion, given as in `actuate`, stays between `low` and `high` [m or rad], zero at rest.

        Each pushes only, and one that is left out does not stop. softness [m/N, rad/Nm]: how far a stop gives way per unit
        of force. A solve may move them: ksd.solve(scene, {"stop.high": 3e-3}). The default name is "link.stop". Raises
        SceneError.
        """
        component = {"along": along, "about": about, "at": at, "relative_to": relative_to}
        parts, default = self._drive_terms(link, **component, joint=joint, motion=motion, terms=terms)
        label = _free_name(name, f"{default}.stop", self._one_sided(), "stop")
        checked = check_drive_in_plane(Drive(label, parts), self.plane, "stop")
        self._stops.append(Stop(label, checked.terms, low, high, softness))
        return self._stops[-1]

    def cable(
        self,
        a: Link | str,
        b: Link | str,
        *,
        start: ArrayLike,
        end: ArrayLike,
        via: Sequence[tuple[Link | str, ArrayLike]] = (),
        length: float | None = None,
        stiffness: float | None = None,
        friction: float = 0.0,
        name: str | None = None,
    ) -> Cable:
        """Add a cable, which pulls only, from `start` (3,) [m] on link `a` through the points `via` to `end` on link `b`.

        via: (link, point (3,) [m]) in order, which guide it without friction. length [m]: without tension, default that at
        rest; stiffness [N/m]: of the whole cable, which cannot stretch when None. A solve shortens it by its name:
        ksd.solve(scene, tendon=2e-3). The default name is "cable". Raises SceneError.
        """
        label = _free_name(name, "cable", self._one_sided(), "cable")
        owner = f"cable '{label}'"
        if number(friction, "friction", owner=owner):
            raise SceneError(
                f"{owner}: friction = {friction:g}: guides of a cable are without friction; leave it out."
            )
        if isinstance(via, str) or not all(isinstance(pair, tuple | list) and len(pair) == 2 for pair in via):
            raise SceneError(
                f"{owner}: via = {show(via)} must be pairs (link, point) in a list, via=[('ground', (0, 0, 0))]."
            )
        points = [(a, start), *via, (b, end)]
        named = tuple((self._checked_link(link, owner), as_given(at)) for link, at in points)
        if len({link for link, _ in named}) == 1:
            raise SceneError(
                f"{owner} connects link '{named[0][0]}' with itself; it needs two different links."
            )
        self._cables.append(Cable(label, named, length, stiffness))
        return self._cables[-1]

    def surface(
        self,
        link: Link | str,
        shape: ContactShape,
        *,
        at: ArrayLike | None = None,
        axis: Axis | None = None,
        toward: Axis | None = None,
        name: str | None = None,
    ) -> Surface:
        """Give a link a surface of a shape of `ksd.shapes`, which touches those that `contact` names with it.

        at (3,) [m]: its centre, or a point of a wall, global at rest; default is the place of a link that is a point of a
        leaf. axis: its z, for a wall the direction out of it, by default the normal of the plane; toward: its x. The default
        name is "link.surface". Raises SceneError.
        """
        label = _free_name(name, f"{link_name(link)}.surface", {s.name for s in self._surfaces}, "surface")
        owner = f"surface '{label}'"
        known = self._checked_link(link, owner)
        if not isinstance(shape, ContactShape):
            hint = "ksd.shapes.disc(radius) and the like"
            raise SceneError(
                f"{owner}: {show(shape)} is no shape to touch; give one of {hint} (ksd.circle is a section)."
            )
        place = self._position_or_default(known, at)
        if place is None:
            raise SceneError(f"{owner}: 'at' is missing; give its centre (x, y, z) in m.")
        if axis is None:
            if shape.kind == "wall":
                raise SceneError(f"{owner}: 'axis' is missing; give the direction out of the wall.")
            axis = plane_normal(self.plane) if self.plane else "z"
        z = direction(axis, "axis", owner=owner)
        if shape.is_plane and self.plane is None:
            raise SceneError(
                f"{owner}: a {shape.kind} lives in a plane; say the plane of the mechanism, or give a ball, box, capsule or "
                "ellipsoid."
            )
        if toward is None:
            toward = next(e for e in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)) if abs(dot(e, z)) < 0.9)
            toward = unit([c - dot(toward, z) * d for c, d in zip(toward, z, strict=True)])
        x = made_perpendicular(direction(toward, "toward", owner=owner), z, "toward", owner)
        if x is None:
            raise SceneError(f"{owner}: toward must be across axis.")
        if self.plane is not None:
            normal = plane_normal(self.plane)
            if shape.kind == "wall" and abs(dot(z, normal)) > PERPENDICULAR:
                raise SceneError(
                    f"{owner} leaves the plane {self.plane}: axis = {show(z)}; give a direction in it."
                )
            if shape.is_plane and abs(dot(z, normal)) < 1.0 - PERPENDICULAR:
                raise SceneError(f"{owner} leaves the plane {self.plane}: axis = {show(z)}; leave it out.")
            if not (shape.is_plane or shape.kind in ("wall", "point")):
                raise SceneError(
                    f"{owner}: a {shape.kind} in the plane {self.plane}; give a disc, ellipse or polygon."
                )
        at_rest = vector(as_given(place), "at", owner=owner, unit="m")
        self._surfaces.append(Surface(label, known, shape, at_rest, z, x))
        return self._surfaces[-1]

    def contact(
        self,
        a: Surface | Link | PlacedLeaf | str,
        b: Surface | Link | PlacedLeaf | str,
        *,
        friction: float = 0.0,
        softness: float = 0.0,
        name: str | None = None,
    ) -> Contact:
        """Let two surfaces touch, with Coulomb friction; each is a surface, its name, or a link that is a point of a leaf.

        One of them may be a free-form leaf, whose surface, half a thickness from its centreline and as wide as it, a disc,
        ball, ellipse or point touches anywhere. Only pairs that are named touch. softness [m/N]: how far they sink in per
        force. The default name is "a-b". Raises SceneError.
        """
        first, second = (self._surface(part) for part in (a, b))
        label = _free_name(name, f"{first.name}-{second.name}", {c.name for c in self._contacts}, "contact")
        owner = f"contact '{label}'"
        if isinstance(first, Surface) and isinstance(second, Surface):
            check_pair(owner, first, second)
        elif isinstance(first, PlacedLeaf) and isinstance(second, PlacedLeaf):
            raise SceneError(
                f"{owner}: contact of two leaf springs, or of one with itself, is not known; ask pose.clearance for their "
                "distance, or put a surface on a link in the place of one."
            )
        else:
            placed, surface = (first, second) if isinstance(first, PlacedLeaf) else (second, first)
            assert isinstance(placed, PlacedLeaf) and isinstance(surface, Surface)
            section = placed.leaf.section
            check_leaf_pair(
                owner,
                placed.name,
                surface,
                flat=self.plane is not None,
                is_round=round_ratio(section) is not None,
            )
        self._contacts.append(Contact(label, first.name, second.name, friction, softness))
        return self._contacts[-1]

    def _surface(self, part: Surface | Link | PlacedLeaf | str) -> Surface | PlacedLeaf:
        """A surface or leaf of this mechanism; a link that is a point of a leaf gets a surface. Raises SceneError."""
        label = getattr(part, "name", part)
        known: list[Surface | PlacedLeaf] = [
            *([] if isinstance(part, PlacedLeaf) else self._surfaces),
            *self._leaves,
        ]
        found = next((s for s in known if s.name == label), None)
        if found is not None:
            return found
        if isinstance(label, str) and label in self._links and self._links[label].at is not None:
            return self.surface(label, ContactShape("point", (0.0,)), name=label)
        if isinstance(label, str) and any(label.startswith(f"{joint.name}/") for joint in self._joints):
            raise SceneError(
                f"contact: '{label}' is a leaf spring of a joint, whose record knows no contact along it; make the joint "
                "free-form (mechanism.constrain), or touch its links."
            )
        raise SceneError(
            f"contact: there is no surface {show(label)}{name_hint(label, [s.name for s in self._surfaces])}; say "
            "mechanism.surface(link, shape, at=) first"
        )

    def _one_sided(self) -> set[str]:
        """Names of stops, cables and drives, which share the values of a solve."""
        cables = {cable.name for cable in self._cables}
        return cables | {stop.name for stop in self._stops} | {drive.name for drive in self._drives}

    # Questions

    def distance(
        self,
        a: Link | str,
        b: Link | str,
        *,
        start: ArrayLike,
        end: ArrayLike,
        along: Axis | None = None,
        turns_with: Link | str | None = None,
        name: str,
    ) -> Distance:
        """Report the distance of the point `end` (3,) [m] of link `b` from the point `start` (3,) [m] of link `a`.

        It is `pose.distance(name)`, and the column "distance_NAME_mm" of sweeps, jobs and gradients, for example the
        opening of a jaw. along: report the signed component along this direction, "x" of the scene or a vector (3,), which
        turns with the link `turns_with` where one is named; None for the whole distance. Raises SceneError.
        """
        owner = f"distance '{word(name, 'name', owner='distance')}'"
        if name in {d.name for d in self._distances}:
            raise SceneError(f"{owner}: the name is used already; every distance needs its own.")
        first, second = self._link_pair(a, b, owner)
        axis = None if along is None else as_given(along)
        carrier = None if turns_with is None else self._checked_link(turns_with, owner)
        added = Distance(name, first, second, as_given(start), as_given(end), axis, carrier)
        self._distances.append(added)
        return added

    def sensor(
        self,
        link: Link | str,
        *,
        along: Axis | None = None,
        about: Axis | None = None,
        at: ArrayLike | None = None,
        relative_to: Link | str | None = None,
        kind: Literal["displacement", "rotation", "velocity", "acceleration"] | None = None,
        name: str | None = None,
    ) -> Sensor:
        """Observe the motion of point `at` (3,) [m] of a link along a direction, or its rotation about one.

        kind: the motion itself ("displacement" or "rotation", the default), its rate or its acceleration; answered by
        `pose.response` and the like. relative_to: ground, which a shaken base moves with it, a link, in whose axes the
        direction is then fixed, or "absolute", in space; the default is "absolute" for an acceleration, ground for the
        others. The default name is that of the link. Raises SceneError.
        """
        used = {s.name for s in self._sensors}
        label = _free_name(name, link_name(link), used, "sensor")
        owner = f"sensor '{label}'"
        absolute = relative_to == "absolute" and "absolute" not in self._links
        absolute |= relative_to is None and kind == "acceleration"
        base = None if absolute or relative_to == GROUND else relative_to
        term = self._component(link, along, about, at, base, owner)
        own = "rotation" if along is None else "displacement"
        added = Sensor(label, term, own if kind is None else kind, absolute)
        check_drive_in_plane(Drive(label, (added.term,)), self.plane, "sensor")
        self._sensors.append(added)
        return added

    # The whole

    def validate(self) -> None:
        """Raise SceneError for errors of the whole mechanism, such as unconnected links or two drives on one freedom."""
        check_scene(self.draft())

    def scene(self) -> Scene:
        """The frozen, validated description; the same object again while nothing has changed. Raises SceneError."""
        last, fields = self._last, self._scene_fields()
        if last is not None and last[0].is_immutable and hold_same_objects(fields, last[1]):
            return last[0]
        frozen = Scene(**fields)
        if whole_checks_enabled():
            check_scene(frozen)
            self._last = frozen, fields
        return frozen

    def draft(self) -> Scene:
        """The frozen description of what was stated so far, without validation."""
        return Scene(**self._scene_fields())

    def _scene_fields(self) -> dict[str, Any]:
        """The fields of `Scene` by name."""
        points = [p.name for p in self._points]
        # kind by kind, and coil springs before torsion springs, as in scene files
        hinges = sorted(self._hinges.values(), key=lambda h: h[0].kind)
        return {
            "name": self.name,
            "links": (*(n for n in self._links if n not in points), *points),
            "joints": tuple(self._joints),
            "leaves": tuple(self._leaves),
            "drives": tuple(self._drives),
            "supports": (*self._supports, *(s for _, supports in hinges for s in supports)),
            "loads": tuple(self._loads),
            "line_loads": tuple(x for x in self._line_loads if isinstance(x, LineLoad)),
            "pressures": tuple(x for x in self._line_loads if isinstance(x, Pressure)),
            "masses": tuple(self._masses),
            "plane": self.plane,
            "hinges": tuple(hinge for hinge, _ in hinges),
            "points": tuple(self._points),
            "springs": tuple(sorted(self._springs, key=lambda s: isinstance(s, TurnSpring))),
            "distances": tuple(self._distances),
            "sensors": tuple(self._sensors),
            "dampers": tuple(self._dampers),
            "stops": tuple(self._stops),
            "cables": tuple(self._cables),
            "surfaces": tuple(self._surfaces),
            "contacts": tuple(self._contacts),
            "compliances": tuple(self._compliances.values()),
            "heats": tuple(self._heats),
            "fits": tuple(self._fits),
            "consider": self._consider,
            "gravity": self._gravity,
        }


def _free_name(name: str | None, default: str, used: set[str], kind: str, *, each: str = "") -> str:
    """`name` if it is not in `used`, or `default`, numbered if necessary. Raises SceneError.

    kind and each: words of the message for a used name, "the {kind} name ... every {kind}" or "the name ... every {each}".
    """
    if name is None:
        return unused_name(default, used)
    if word(name, "name", owner=kind) in used:
        what, each = ("name", each) if each else (f"{kind} name", kind)
        raise SceneError(f"the {what} '{name}' is used already; every {each} needs its own name.")
    return name


def _no_placed_joint_message(given: Any) -> str:
    """Message for an argument `joint` that is neither a placed joint nor a name."""
    first = given[0] if given and isinstance(given, tuple) else given
    if isinstance(first, PlacedLeaf):
        return (
            "joint: what mechanism.constrain and mechanism.leaf return are leaf springs, which have no intended motion; "
            "drive a link, mechanism.actuate(link, ...), or connect by mechanism.join"
        )
    if isinstance(given, Link):
        return f"joint: '{given.name}' is a link; drive it by mechanism.actuate(link, ...)"
    what = (
        f"a {given.family} is not part of the mechanism"
        if isinstance(given, Joint)
        else f"{show(given)} is no joint"
    )
    return f"joint: {what}; give what mechanism.join returned, or its name"
