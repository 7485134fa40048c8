"""hypothesis strategies: scenes that hold together, calls with a wrong word in them, scene files right, bent and random."""

import json
import math

import numpy as np
from hypothesis import strategies as st
from scenes import STEEL, cross_flexure

import ksd

STORED = """
name = "lever"
gravity = [0, -9.81, 0]
links = ["arm", "hand"]
[options]
method = "conventional"
[material.steel]
E = "200 GPa"
G = "76.9 GPa"
density = 7800
[section.blade]
kind = "rectangle"
thickness = "1 mm"
width = "40 mm"
[joint.cross]
family = "cross_flexure"
material = "steel"
length = "100 mm"
angle = "45 deg"
thickness = "1 mm"
widths = ["40 mm", 0.02]
[[join]]
a = "ground"
b = "arm"
joint = "cross"
at = [0, 0, "1 mm"]
axis = "z"
toward = "x"
[[leaf]]
a = "arm"
b = "hand"
start = [0.1, 0.2, 0]
end = [0.2, 0.2, 0]
width_axis = "z"
section = "blade"
material = "steel"
elements = 3
[[actuate]]
name = "push"
link = "arm"
along = "x"
at = [0, 0.2, 0]
value = "2 mm"
[[support]]
link = "hand"
along = "z"
at = [0.2, 0.2, 0]
[[load]]
link = "hand"
force = ["10 N", 0, 0]
at = [0.2, 0.2, 0]
[[mass]]
link = "hand"
mass = "2 kg"
at = [0.2, 0.2, 0]
inertia = [1e-3, 1e-3, 1e-3]
"""
"""A scene file with every table in it."""
WORDS = (
    "",
    "ground",
    "arm",
    "x",
    "z",
    "-y",
    "steel",
    "rectangle",
    "cross_flexure",
    "1 mm",
    "3 parsec",
    "45 deg",
    "translation",
)


def powers(low, high):
    """Floats evenly spread in their logarithm."""
    return st.floats(math.log10(low), math.log10(high)).map(lambda e: 10.0**e)


directions = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)


@st.composite
def leaf_scenes(draw, *, most_load=20.0):
    """One to three leaves in a row or a tree: micrometres to kilometres, any stiffness, in or out of the plane.

    Loads in units of EI/L^2 up to `most_load`; drives up to 0.4 L or 1.2 rad. Returns (mechanism, targets).
    """
    unit, E = draw(powers(1e-6, 1e3)), draw(powers(1e3, 1e12))
    stuff = ksd.Material(E=E, nu=draw(st.floats(0.0, 0.45)))
    flat = draw(st.booleans())
    scene = ksd.Mechanism("random leaf springs")
    places, links = [np.zeros(3)], [scene.ground]
    bend = 0.0
    for k in range(draw(st.integers(1, 3))):
        along = draw(directions)
        if flat:
            along[2] = 0.0
            along = along if np.linalg.norm(along) > 0.1 else np.array([1.0, 0.0, 0.0])
        along = along / np.linalg.norm(along)
        base = draw(st.integers(0, k))
        length = unit * draw(st.floats(0.2, 1.0))
        across = (0, 0, 1) if flat else np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        section = ksd.rectangle(length / draw(powers(30, 3000)), length * draw(st.floats(0.05, 0.5)))
        link = scene.link(f"part {k}")
        end = places[base] + length * along
        elements = draw(st.sampled_from([None, None, 2, 5]))
        scene.leaf(links[base], link, start=tuple(places[base]), end=tuple(end), section=section, material=stuff,
                   width_axis=tuple(across), elements=elements)  # fmt: skip
        places.append(end)
        links.append(link)
        bend = min(bend or math.inf, E * section.Iz / length**2)
    targets = {}
    tip, at = links[-1], tuple(places[-1])
    if draw(st.booleans()):
        if draw(st.booleans()):
            scene.actuate(tip, along=draw(st.sampled_from("xy" if flat else "xyz")), at=at, name="drive")
            targets["drive"] = unit * draw(st.floats(-0.4, 0.4)) * 0.2
        else:
            scene.actuate(tip, about="z", name="drive")
            targets["drive"] = draw(st.floats(-1.2, 1.2))
    if draw(st.booleans()) or not targets:
        force = draw(directions) * bend * draw(st.floats(0.0, most_load))
        scene.load(
            tip,
            force=tuple(force * (1, 1, 0 if flat else 0.2)),
            at=at,
            following=draw(st.booleans()) and not targets,
        )
    return scene, targets


@st.composite
def joint_scenes(draw, *, most_load=20.0):
    """One cross flexure, in its trained range and a little beyond, placed anywhere, turned and loaded."""
    unit = draw(powers(1e-3, 1e2))
    length = unit
    joint = ksd.CrossFlexure(
        STEEL,
        length=length,
        angle=draw(st.floats(0.4, 1.2)),
        thickness=length / draw(powers(30, 1000)),
        widths=(length * draw(st.floats(0.1, 0.6)), length * draw(st.floats(0.05, 0.3))),
    )
    scene = ksd.Mechanism("random joint")
    tip = scene.link("tip")
    placed = scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x", name="hinge")
    scene.actuate_joint(placed, name="turn")
    if draw(st.booleans()):
        EI = min(STEEL.E * leaf.section.Iz for leaf in joint.leaves())
        force = draw(directions) * EI / length**2 * draw(st.floats(0.0, most_load))
        scene.load(tip, force=tuple(force), at=joint.pose_B)
    return scene, {"turn": draw(st.floats(-1.3, 1.3))}


@st.composite
def loaded_fourbars(draw, *, most_load=4000.0):
    """The fourbar of paper 1, driven anywhere, with a force and a moment on one of its links."""
    from scenes import fourbar

    reading = draw(st.sampled_from([1, 2]))
    scene = fourbar(reading=reading)
    link, at = draw(st.sampled_from([("top", (0.0, 0.37, 0.0)), ("left", (-0.2, 0.2, 0.0))]))
    force = draw(directions) * draw(powers(10.0, most_load))
    moment = draw(directions) * np.linalg.norm(force) * draw(st.floats(0.0, 0.15))
    scene.load(link, force=tuple(force), moment=tuple(moment), at=at)
    return scene, {"top": draw(st.floats(-0.3, 0.3))}


junk = st.one_of(
    st.none(), st.booleans(), st.text(max_size=6), st.sampled_from(WORDS), st.integers(-3, 3), st.integers(),
    st.floats(), st.sampled_from([0.0, -1.0, 1e-300, 1e300, math.inf, math.nan]), st.binary(max_size=3),
    st.lists(st.one_of(st.floats(), st.text(max_size=2), st.none()), max_size=4), st.just({}), st.just(object()),
    st.just(np.array([1.0, 2.0])), st.just(1j), st.just(STEEL),
)  # fmt: skip
"""Values that mostly do not belong where they are put."""


def _started():
    """A mechanism with a joint, and what calls on it need."""
    scene = ksd.Mechanism("broken")
    arm, hand = scene.links("arm", "hand")
    placed = scene.join(scene.ground, arm, cross_flexure(), at=(0, 0, 0), axis="z", toward="x")
    return scene, arm, hand, placed


LEAF = {
    "start": (0, 0, 0),
    "end": (0.1, 0, 0),
    "section": ksd.rectangle(1e-3, 0.02),
    "material": STEEL,
    "width_axis": "z",
}
FLEXURE = {"length": 0.1, "angle": 0.8, "thickness": 1e-3, "widths": (0.04, 0.02)}
AT = {"at": (0.1, 0.2, 0)}
CALLS = {
    "material": lambda m, w: ksd.Material(**{"E": 2e11, "nu": 0.3, "density": 7800.0, **w}),
    "rectangle": lambda m, w: ksd.rectangle(**{"thickness": 1e-3, "width": 0.02, **w}),
    "tube": lambda m, w: ksd.tube(**{"outer": 0.02, "inner": 0.01, **w}),
    "circle": lambda m, w: ksd.circle(**{"diameter": 0.02, **w}),
    "leaf": lambda m, w: m[0].leaf(**{"a": m[1], "b": m[2], **LEAF, **w}),
    "cross": lambda m, w: ksd.CrossFlexure(**{"material": STEEL, **FLEXURE, **w}),
    "join": lambda m, w: m[0].join(
        **{"a": m[1], "b": m[2], "joint": cross_flexure(), **AT, "axis": "z", "toward": "x", **w}
    ),
    "actuate": lambda m, w: m[0].actuate(**{"link": m[1], "along": "x", **AT, "name": "d", **w}),
    "turn": lambda m, w: m[0].actuate(**{"link": m[1], "about": "x", "name": "d", **w}),
    "joint drive": lambda m, w: m[0].actuate_joint(**{"joint": m[3], "name": "d", **w}),
    "support": lambda m, w: m[0].support(**{"link": m[1], "along": "z", **AT, **w}),
    "load": lambda m, w: m[0].load(**{"link": m[1], "force": (1, 0, 0), "moment": (0, 0, 1), **AT, **w}),
    "mass": lambda m, w: m[0].mass(**{"link": m[1], "mass": 1.0, **AT, "inertia": (1e-3,) * 3, **w}),
    "mesh": lambda m, w: ksd.Mesh(**{"leaf": "strain", "orders": (4, 3, 5), "points": 7, **w}),
    "chain": lambda m, w: ksd.Mesh(**{"leaf": "corotational", "elements": 3, **w}),
}
"""Calls of a designer, by name: f(started mechanism, words that replace the right ones)."""
KEYS = {
    "material": ("E", "nu", "density", "name"),
    "rectangle": ("thickness", "width"),
    "tube": ("outer", "inner"),
    "circle": ("diameter",),
    "leaf": ("a", "b", *LEAF, "elements", "orders", "name", "profile", "curve"),
    "cross": ("material", *FLEXURE),
    "join": ("a", "b", "joint", "at", "axis", "toward", "name"),
    "actuate": ("link", "along", "at", "name"),
    "turn": ("link", "about", "name"),
    "joint drive": ("joint", "name", "motion"),
    "support": ("link", "along", "at", "name"),
    "load": ("link", "force", "moment", "at", "following", "name"),
    "mass": ("link", "mass", "at", "inertia"),
    "mesh": ("leaf", "orders", "points", "warping"),
    "chain": ("leaf", "elements"),
}


@st.composite
def broken_calls(draw):
    """(name, words): one of CALLS with one or two words replaced by junk."""
    name = draw(st.sampled_from(sorted(CALLS)))
    keys = draw(st.lists(st.sampled_from(KEYS[name]), min_size=1, max_size=2, unique=True))
    return name, {key: draw(junk) for key in keys}


SOLVE_WORDS = {
    "targets": junk, "method": junk, "accuracy": junk, "mesh": junk, "relinearisations": junk,
    "extrapolate": junk, "strict": junk,
    "turn": junk, "tip": junk, "effects": junk, "with_": junk, "without": junk,
}  # fmt: skip


@st.composite
def broken_questions(draw):
    """Words for `ksd.solve`, one or two of them junk."""
    keys = draw(st.lists(st.sampled_from(sorted(SOLVE_WORDS)), min_size=1, max_size=2, unique=True))
    return {key: draw(SOLVE_WORDS[key]) for key in keys}


@st.composite
def bent_files(draw):
    """STORED with lines dropped, doubled, swapped, or their values replaced."""
    lines = STORED.strip().splitlines()
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(lines) - 1))
        way = draw(st.integers(0, 4))
        key, equals, _ = lines[at].partition(" = ")
        if way == 0:
            del lines[at]
        elif way == 1:
            lines.insert(at, lines[at])
        elif way == 2 and equals:
            lines[at] = f"{key} = {draw(toml_values)}"
        elif way == 3:
            other = draw(st.integers(0, len(lines) - 1))
            lines[at], lines[other] = lines[other], lines[at]
        else:
            lines[at] = draw(st.text(max_size=3)) + lines[at]
    return "\n".join(lines).encode("utf-8", errors="surrogatepass")


plain_values = st.one_of(
    st.booleans().map(lambda b: "true" if b else "false"),
    st.integers(-(2**40), 2**40).map(str),
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.sampled_from(["nan", "inf", "-inf", "0", "-1", "1e-300", "1e300", "2024-01-01", "12:00:00"]),
    st.sampled_from(WORDS).map(json.dumps),
    st.text(st.characters(codec="ascii", exclude_categories=["Cc"]), max_size=6).map(json.dumps),
)
toml_values = st.recursive(
    plain_values,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4).map(lambda v: "[" + ", ".join(v) + "]"),
        inner.map(lambda v: "{ a = " + v + " }"),
    ),
    max_leaves=5,
)
"""TOML values as text."""
_TABLES = ("options", "material.steel", "section.blade", "joint.cross", "material", "odd", "load", "leaf")
_LISTS = ("join", "leaf", "wire", "actuate", "support", "load", "mass", "constrain", "odd")
_KEYS = (
    "name", "links", "gravity", "a", "b", "joint", "at", "axis", "toward", "family", "length", "angle", "material",
    "section", "kind", "start", "end", "value", "link", "along", "about", "force", "moment", "mass", "inertia", "odd",
)  # fmt: skip


@st.composite
def random_trees(draw):
    """Files of known words in random places."""
    pairs = st.lists(st.tuples(st.sampled_from(_KEYS), toml_values), max_size=4, unique_by=lambda p: p[0])
    text = [f"{k} = {v}" for k, v in draw(pairs)]
    for table in draw(st.lists(st.sampled_from(_TABLES), max_size=3, unique=True)):
        text += [f"[{table}]", *(f"{k} = {v}" for k, v in draw(pairs))]
    for entry in draw(st.lists(st.sampled_from(_LISTS), max_size=3)):
        text += [f"[[{entry}]]", *(f"{k} = {v}" for k, v in draw(pairs))]
    return "\n".join(text).encode()


def _bitten(bite):
    """STORED with some bytes overwritten."""
    at, new = bite
    content = bytearray(STORED.encode())
    at %= len(content)
    content[at : at + len(new)] = new
    return bytes(content)


scene_files = st.one_of(
    st.binary(max_size=200),
    bent_files(),
    random_trees(),
    st.tuples(st.integers(0, 10_000), st.binary(max_size=4)).map(_bitten),
)
"""Bytes of scene files: noise, known words anywhere, a good file bent or bitten."""
