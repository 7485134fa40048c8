"""The tables and keys of scene files and the kind of every key, from which reading, writing and the JSON schema follow.

A kind is a dimension ("length": a number in SI, or text with a unit such as "100 mm"), "number", "text", "flag" (true or
false), "direction" ("x", "-z" or three numbers), the name of a "material", "section" or "joint" of the file, "names" (a list
of texts), or "any", whose value is checked by the constructor it is passed to. "length[3]" is a list of three; "length[]" is
one value, a list of any length, or lists of lists; "!" marks a required key. Keys that are left out take the default of the
Python parameter of the same name: [[join]] stands for `Mechanism.join`, [[leaf]] for `Mechanism.leaf`, [material.NAME] for
`ksd.Material`, [joint.NAME] for the class of its family. Bounds are checked there.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from ksd.scene.curve import Arc, FreeCurve
from ksd.scene.joint import Joint
from ksd.scene.plane_curves import Legendre, Sine, Spline
from ksd.scene.profile import CircularNotch, FilletedNotch, StiffenedMiddle, Taper

Schema = dict[str, str]
"""Kind by key of a table."""

TOP: Schema = {
    "name": "text",
    "plane": "text",
    "gravity": "acceleration[3]",
    "links": "names!",
    "consider": "names",
}

MATERIAL: Schema = {
    "E": "stress", "G": "stress", "nu": "number", "density": "density", "expansion": "expansion",
    "yield_stress": "stress", "fatigue_limit": "stress", "loss_factor": "number", "name": "text",
}  # fmt: skip

SECTIONS: dict[str, Schema] = {
    "rectangle": {"thickness": "length!", "width": "length!", "cowper": "number", "name": "text"},
    "circle": {"diameter": "length!", "cowper": "number", "name": "text"},
    "tube": {"outer": "length!", "inner": "length!", "cowper": "number", "name": "text"},
    "polygon": {"points": "length[]!", "holes": "length[]", "mesh_size": "length", "nu": "number", "name": "text"},
    "numbers": {
        "A": "area!", "J": "second moment!", "Iy": "second moment!", "Iz": "second moment!", "ky": "number", "kz": "number",
        "Iw": "warping constant", "width": "length", "thickness": "length", "shear_centre": "length[2]", "tilt": "angle",
        "name": "text", "outline": "length[]",
    },
}  # fmt: skip
"""Keys of a [section.NAME] by its `kind`, the name of a function of `ksd.section`."""

DRAWN: Schema = {"name": "text", "length": "length", "windows": "flag", "held_by_others": "flag"}
"""Keys of a [joint.NAME] of family "drawn", besides its tables [blocks], [shape], [[leaf]], [[wire]] and [[motion]]."""

MOTIONS: dict[str, Schema] = {
    kind: {
        "name": "text!", "kind": "text!", "axis": "direction!", "range": f"{dimension}[2]!", "point": "length[3]",
    }
    for kind, dimension in (("rotation", "angle"), ("translation", "length"))
}  # fmt: skip
"""Keys of a [[joint.NAME.motion]] by its `kind`."""

LEAF: Schema = {
    "start": "length[3]!", "end": "length[3]!", "width_axis": "direction", "material": "material!", "name": "text",
    "elements": "any", "orders": "any",
}  # fmt: skip
"""Keys of every leaf and wire, besides those of one of `SIZES`."""

SIZES: dict[str, Schema] = {
    "wire": {"diameter": "length!"},
    "leaf": {"section": "section!"},
    "rectangle": {"thickness": "length!", "width": "length!"},
}

SHAPES: dict[str, dict[str, Schema]] = {
    "curve": {
        "arc": {"radius": "length!", "angle": "angle!"},
        "sine": {"amplitudes": "angle[]!", "length": "length", "chord": "length"},
        "legendre": {"coefficients": "angle[]!", "length": "length", "chord": "length", "breaks": "number[]"},
        "spline": {"points": "length[]!", "start": "angle", "end": "angle"},
    },
    "profile": {
        "taper": {"thickness": "length[2]!", "width": "length[2]!"},
        "circular_notch": {"radius": "length!", "minimum": "length!", "width": "length!"},
        "filleted_notch": {"length": "length!", "radius": "length!", "minimum": "length!", "width": "length!"},
        "stiffened_middle": {
            "thickness": "length!", "width": "length!", "middle": "length!", "part": "number!",
        },
    },
}  # fmt: skip
"""Keys of the tables [leaf.curve] and [leaf.profile], by their `kind`."""

SHAPE_CLASSES: dict[str, dict[str, tuple[type[Any], Callable[..., Any]]]] = {
    "curve": {
        "arc": (Arc, Arc), "sine": (Sine, FreeCurve.sine), "legendre": (Legendre, FreeCurve.legendre),
        "spline": (Spline, FreeCurve.spline),
    },
    "profile": {
        "taper": (Taper, Taper), "circular_notch": (CircularNotch, CircularNotch),
        "filleted_notch": (FilletedNotch, FilletedNotch), "stiffened_middle": (StiffenedMiddle, StiffenedMiddle),
    },
}  # fmt: skip
"""By the same keys and kinds: the class whose attributes are those keys, and the callable that makes the shape from them."""

BLOCKS: Schema = {"start_block": "text!", "end_block": "text!"}
"""Keys for the blocks of a leaf of a drawn joint; a free-form leaf has `LINK_PAIR`."""

LINK_PAIR: Schema = {"a": "text!", "b": "text!"}

_PLACEMENT = LINK_PAIR | {
    "joint": "joint!", "at": "length[3]!", "axis": "direction!", "toward": "direction!", "name": "text",
}  # fmt: skip
_COMPONENT = {
    "link": "text",
    "along": "direction",
    "about": "direction",
    "at": "length[3]",
    "relative_to": "text",
}
_MOTION = _COMPONENT | {"name": "text", "joint": "text", "motion": "text"}

VIA: Schema = {"link": "text!", "at": "length[3]!"}
"""Keys of an item of the `via` of [[cable]]."""

LIMITS: dict[str, Schema] = {
    "length": {"low": "length", "high": "length", "softness": "softness"},
    "angle": {"low": "angle", "high": "angle", "softness": "torsional softness"},
    "number": {"low": "number", "high": "number", "softness": "number"},
}
"""Keys of [[stop]] besides those of its motion, by the dimension of that."""

TERM: Schema = _COMPONENT | {"link": "text!", "coefficient": "number"}
"""Keys of an item of the `terms` of [[actuate]] or [[support]]."""

STATEMENTS: dict[str, Schema] = {
    "join": _PLACEMENT,
    "constrain": _PLACEMENT,
    "leaf": LINK_PAIR | LEAF,
    "wire": LINK_PAIR | LEAF,
    "point": {"leaf": "text!", "s": "length!", "name": "text"},
    "actuate": _MOTION,
    "support": _MOTION,
    "pin": LINK_PAIR | {"at": "length[3]", "axis": "direction", "name": "text"},
    "ball": LINK_PAIR | {"at": "length[3]", "name": "text"},
    "cylindrical": LINK_PAIR | {"at": "length[3]", "axis": "direction!", "name": "text"},
    "slider": {
        "link": "text!", "along": "direction!", "at": "length[3]", "relative_to": "text", "name": "text",
    },
    "load": {
        "link": "text!", "force": "force[3]", "moment": "moment[3]", "at": "length[3]", "following": "flag",
        "name": "text",
    },
    "line_load": {
        "leaf": "text!", "force": "stiffness[3]", "to": "stiffness[3]", "moment": "moment per length[3]",
        "to_moment": "moment per length[3]", "start": "length", "end": "length", "name": "text",
    },
    "pressure": {
        "leaf": "text!", "pressure": "stress!", "side": "text", "start": "length", "end": "length", "name": "text",
    },
    "mass": {"link": "text!", "mass": "mass!", "inertia": "inertia[]", "at": "length[3]"},
    "spring": LINK_PAIR | {
        "start": "length[3]!", "end": "length[3]!", "stiffness": "stiffness!", "free_length": "length", "name": "text",
    },
    "distance": LINK_PAIR | {
        "start": "length[3]!", "end": "length[3]!", "along": "direction", "turns_with": "text", "name": "text!",
    },
    "sensor": _COMPONENT | {"link": "text!", "kind": "text", "name": "text"},
    "damper": LINK_PAIR | {
        "along": "direction", "about": "direction", "at": "length[3]", "damping": "damping!", "name": "text",
    },
    "stop": _MOTION,
    "cable": LINK_PAIR | {
        "start": "length[3]!", "end": "length[3]!", "length": "length", "stiffness": "stiffness", "friction": "number",
        "name": "text",
    },
    "surface": {
        "link": "text!", "shape": "text!", "radius": "length", "semi_axes": "length[]", "size": "length[3]",
        "length": "length", "points": "length[]", "at": "length[3]", "axis": "direction", "toward": "direction",
        "name": "text",
    },
    "contact": LINK_PAIR | {"friction": "number", "softness": "softness", "name": "text"},
    "joint_spring": {
        "joint": "text!", "stiffness": "torsional stiffness!", "rest_angle": "angle", "motion": "text", "name": "text",
    },
    "turn_spring": LINK_PAIR | {
        "at": "length[3]!", "axis": "direction!", "stiffness": "torsional stiffness!", "rest_angle": "angle", "name": "text",
    },
    "compliance": {
        "link": "text!", "hub": "length[3]", "width_axis": "direction", "section": "section", "material": "material",
        "matrix": "text", "points": "length[]", "stiffness": "any",
    },
    "heat": {"temperature": "temperature", "through": "temperature", "leaves": "any"},
    "fit": {"leaf": "text!", "natural_length": "length", "shift": "length[3]", "turn": "angle[3]"},
}  # fmt: skip
"""Keys of the arrays [[NAME]], each for the method of `Mechanism` of that name, in the order in which they are applied."""

SIMULATE: Schema = {
    "until": "time!", "dt": "time", "accuracy": "number", "method": "text", "rho": "number", "damping_at": "frequency",
    "release": "time", "every": "any", "mass_at_ends": "any", "start": "text", "drives": "any", "loads": "any",
    "base": "any", "speeds": "any", "stop": "any",
}  # fmt: skip
"""Keys of the table [simulate], the words of `ksd.Simulation`."""

REPORT: Schema = {"link": "text", "at": "length[3]", "along": "direction", "freed": "names"}
"""Keys of the table [report], the words of `Mechanism.report`."""

CONTACT_SHAPES = {
    "point": (), "disc": ("radius",), "ball": ("radius",), "wall": (), "ellipse": ("semi_axes",), "polygon": ("points",),
    "box": ("size",), "capsule": ("radius", "length"), "ellipsoid": ("semi_axes",), "polyhedron": ("points",),
}  # fmt: skip
"""Keys of the sizes of a [[surface]] by its `shape`."""
SHAPE_SIZES = ("radius", "semi_axes", "size", "length", "points")
"""All of them, in the order of the arguments of `ksd.shapes`."""

LINK_KEYS = ("a", "b", "link", "relative_to", "turns_with")
"""Keys whose value is the name of a link."""


def family_schema(family: type[Joint]) -> Schema:
    """The keys of a [joint.NAME] of a family: the parameters of its class, with the dimensions it declares."""
    dimensions = {key: f"{dimension}[]" for key, dimension in family.quantities.items()}
    keys = inspect.signature(family).parameters
    kinds = {key: "material" if key == "material" else dimensions.get(key, "any") for key in keys}
    return {key: kind + "!" * (keys[key].default is inspect.Parameter.empty) for key, kind in kinds.items()}
