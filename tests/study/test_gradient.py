"""Gradients: exact identities, against Richardson re-solves, every pitfall of differences, every wrong word."""

import numpy as np
import pytest
from scenes import STEEL, single_joint

import ksd
from ksd.checks import without_whole_checks
from ksd.model.chosen_effects import choose_effects
from ksd.solvers import perturbed
from ksd.study.questions import ALL_QUESTIONS, ROUNDING_TOLERANCE
from ksd.units import deg, mm

ASKED = tuple(q for q in ALL_QUESTIONS if q != "clearance")
"""Of one joint, whose leaf springs share their blocks."""
DENSITY = 7850.0
"""Of the material whose modulus is a parameter."""


def pivot(length, angle, thickness, width, E=200e9, density=DENSITY, force=0.0):
    """A crossed pivot turned by `turn`; `force` [N] along z on its tip."""
    steel = ksd.Material(E=E, G=0.3845 * E, density=density)
    joint = ksd.CrossedPivot(steel, length=length, angle=angle, thickness=thickness, width=width)
    scene = single_joint(joint)
    if force:
        scene.load("tip", force=(0, 0, force), at=joint.pose_B, name="payload")
    return scene


PIVOT = {
    "length": 60 * mm,
    "angle": 43 * deg,
    "thickness": 0.4 * mm,
    "width": 20 * mm,
    "E": 200e9,
    "density": DENSITY,
}


def cross(length, thickness, inner, outer, angle=45 * deg):
    """A cross flexure turned by `turn`."""
    return single_joint(
        ksd.CrossFlexure(STEEL, length=length, angle=angle, thickness=thickness, widths=(inner, outer))
    )


CROSS = {"length": 70 * mm, "thickness": 0.4 * mm, "inner": 30 * mm, "outer": 15 * mm, "angle": 40 * deg}


def arc(radius, angle, thickness, width=20 * mm):
    """An arc hinge, whose orders follow from how far it turns."""
    return single_joint(ksd.ArcHinge(STEEL, radius=radius, angle=angle, thickness=thickness, width=width))


def fourbar(length=100 * mm, height=300 * mm, width=40 * mm, first=1 * mm):
    """A fourbar of paper 1 with one joint of another thickness."""
    sizes = {"length": length, "angle": 45 * deg, "widths": (width, 0.5 * width)}
    joint = ksd.CrossFlexure(STEEL, thickness=1 * mm, **sizes)
    other = ksd.CrossFlexure(STEEL, thickness=first, **sizes)
    scene = ksd.Mechanism("fourbar")
    left, top, right = scene.links("left", "top", "right")
    for a, b, x, y, kind in (
        (scene.ground, left, -0.2, 0, other),
        (left, top, -0.2, height, joint),
        (right, top, 0.2, height, joint),
        (scene.ground, right, 0.2, 0, joint),
    ):
        scene.join(a, b, kind, at=(x, y, 0), axis="z", toward="y")
    scene.actuate(top, along="x", at=(0, height + joint.length_AB, 0), name="top")
    return scene


FOURBAR = {"length": 100 * mm, "height": 300 * mm, "width": 40 * mm, "first": 0.8 * mm}


def resolved(design, at_design, name, *, h=2e-3, **words):
    """(derivative, error) by column: whole solves at six values of a parameter, extrapolated to h = 0."""
    value = at_design[name]
    shares = [s * h * k for k in (1, 0.5, 0.25) for s in (1, -1)]
    rows = [
        list(
            ksd.sweep(
                design,
                designs=[{**at_design, name: value * (1 + s)}],
                method="conventional",
                progress=False,
                **words,
            ).rows()
        )
        for s in shares
    ]
    found = {}
    for column, first in rows[0][0].items():
        if not isinstance(first, float) or column == name:
            continue
        q = np.array([[row[column] for row in one] for one in rows])
        # a factor or stiffness that is infinite has no slope
        if not np.isfinite(q).all():
            continue
        d = [(q[2 * k] - q[2 * k + 1]) / (2 * abs(shares[2 * k]) * value) for k in range(3)]
        four = (4 * d[1] - d[0]) / 3, (4 * d[2] - d[1]) / 3
        six = (16 * four[1] - four[0]) / 15
        found[column] = six, np.abs(six - four[1])
    return found


def compare(gradient, reference, name, at_design, *, bound=1e-6, columns=None):
    """Every column of the reference, as far as the gradient has it; returns how many were compared."""
    count = 0
    for column, (slope, error) in reference.items():
        if column not in gradient.columns or (columns is not None and column not in columns):
            continue
        if (column, 0) in gradient.reasons or not np.isfinite(slope).all():
            continue
        floor = 1e-3 * np.abs(gradient.values[column]) / at_design[name]
        if np.any(np.abs(gradient.values[column]) < ROUNDING_TOLERANCE):
            continue
        off = np.abs(gradient[column, name] - slope)
        # rounding of critical load factors, in the reference as in the gradient
        loose = 100 if "buckling" in column else 1
        assert np.all(off <= loose * bound * np.maximum(np.abs(slope), floor) + 10 * error), (
            column,
            name,
            off / floor,
        )
        count += 1
    return count


@pytest.fixture(scope="module")
def of_pivot():
    return ksd.gradient(pivot, PIVOT, turn=[0.4, 0.5], questions=ASKED, errors=True)


POWER = {
    "moment_Nm": 3,
    "energy_J": 3,
    "_Nm_per_rad": 3,
    "_N_per_m": 1,
    "stress_MPa": 0,
    "buckling": 0,
    "_Hz": -1,
    "_mm": 1,
}
"""What every answer grows with when all lengths grow."""


def test_scaling_of_all_lengths_of_modulus_and_of_density_are_exact(of_pivot):
    relative, seen = of_pivot.relative, set()
    for column in relative.columns:
        if (column, 0) in relative.reasons or not of_pivot.values[column].all():
            continue
        unit = next((u for u in POWER if u in column), None)
        if unit is None:
            continue
        lengths = sum(relative[column, p] for p in ("length", "thickness", "width"))
        np.testing.assert_allclose(lengths, POWER[unit], atol=1e-7, err_msg=column)
        modulus = {"_Hz": 0.5, "buckling": 0.0, "_mm": 0.0}.get(unit, 1.0)
        np.testing.assert_allclose(relative[column, "E"], modulus, atol=1e-7, err_msg=column)
        np.testing.assert_allclose(
            relative[column, "density"], -0.5 if unit == "_Hz" else 0.0, atol=1e-7, err_msg=column
        )
        seen.add(unit)
    assert seen == set(POWER)


def test_work_of_the_drive_and_stiffness_of_the_drive_are_derivatives_by_its_value():
    found = ksd.gradient(
        fourbar, FOURBAR, by="top", top=[0.05, 0.2], questions=("force", "drive_stiffness", "energy")
    )
    np.testing.assert_allclose(found["strain_energy_J", "top"], found.values["top_force_N"], rtol=1e-7)
    np.testing.assert_allclose(found["top_force_N", "top"], found.values["top_stiffness_N_per_m"], rtol=1e-6)


@pytest.mark.parametrize(
    ("design", "at_design", "drives", "names"),
    [
        (pivot, {**PIVOT, "force": 3.0}, {"turn": [0.4]}, ("length", "angle", "force")),
        (cross, {**CROSS, "outer": 12 * mm}, {"turn": [0.3]}, ("thickness", "inner", "angle")),
        (fourbar, FOURBAR, {"top": [0.15]}, ("height", "first")),
        (
            arc,
            {"radius": 30 * mm, "angle": 70 * deg, "thickness": 0.3 * mm},
            {"turn": [0.2]},
            ("radius", "angle"),
        ),
    ],
)
def test_all_answers_are_those_of_solves_beside(design, at_design, drives, names):
    words = {"questions": ALL_QUESTIONS if design is fourbar else ASKED, **drives}
    found = ksd.gradient(design, at_design, by=names, errors=True, **words)
    for name in names:
        assert compare(found, resolved(design, at_design, name, **words), name, at_design) > 8


def test_any_question_of_one_pose():
    pose = ksd.solve(fourbar(**FOURBAR), top=0.1)
    where = (0, 0.3 + 0.0707, 0)
    found = pose.gradient(
        lambda p: {"F": p.forces["top"], "u": p.displacement("top", where)}, by=("first", "top"), design=fourbar,
        at_design=FOURBAR,
    )  # fmt: skip
    whole = ksd.gradient(fourbar, FOURBAR, by="first", top=0.1, questions="force", link="top", at=where)
    assert found["first"]["F"] == pytest.approx(float(whole["top_force_N", "first"][0]), rel=1e-7)
    np.testing.assert_allclose(found["first"]["u"], whole.point["first"][0, :3], atol=1e-8)
    assert found["top"]["u"][0] == pytest.approx(1.0, rel=1e-7)


def test_components_of_loads_are_parameters_of_a_scene():
    scene = pivot(**{**PIVOT, "force": 2.0})
    pose = ksd.solve(scene, turn=0.3, method="full")
    found = pose.gradient(lambda p: p.displacement("tip", (0.04, 0, 0)), by="payload_force_z")[
        "payload_force_z"
    ]
    here = pose.displacement("tip", (0.04, 0, 0))
    more = ksd.solve(pivot(**{**PIVOT, "force": 2.02}), turn=0.3, method="full").displacement(
        "tip", (0.04, 0, 0)
    )
    np.testing.assert_allclose(found, (more - here) / 0.02, rtol=1e-2)
    cases = ksd.gradient(
        pivot, {**PIVOT, "force": 2.0}, by="force", turn=0.3, questions="force",
        loads={"none": [], "more": [{"link": "tip", "force": (0, 0, 4.0), "at": (0.03, 0.01, 0)}]},
    )  # fmt: skip
    slopes = cases["turn_moment_Nm", "force"]
    assert [p["load_case"] for p in cases.poses] == ["none", "more"] and abs(slopes[0] - slopes[1]) > 1e-5


# the pitfalls of the specification, by their numbers


def test_1_orders_that_would_change_are_held():
    """At 90 degrees of arc one side would take one more mode per axis."""
    at_design = {"radius": 30 * mm, "angle": 90 * deg, "thickness": 0.3 * mm}
    there = [
        ksd.compile_scene(arc(**{**at_design, "angle": a * deg})).arrays.members.number[0]
        for a in (89.999, 90.001)
    ]
    assert not np.array_equal(*there)
    words = {"turn": 0.2, "questions": ("force", "support_stiffness")}
    low, jump, high = (
        ksd.gradient(arc, {**at_design, "angle": a * deg}, by="angle", **words) for a in (89.8, 90, 90.2)
    )
    for column in ("turn_moment_Nm", "support_z_N_per_m", "support_rx_Nm_per_rad"):
        mean = 0.5 * (low[column, "angle"] + high[column, "angle"])
        np.testing.assert_allclose(jump[column, "angle"], mean, rtol=3e-4)
    reference = resolved(arc, {**at_design, "angle": 89.7 * deg}, "angle", **words)
    found = ksd.gradient(arc, {**at_design, "angle": 89.7 * deg}, by="angle", **words)
    assert compare(found, reference, "angle", {**at_design, "angle": 89.7 * deg}) > 4


def test_1_what_changes_more_than_numbers_is_refused():
    def growing(length):
        scene = pivot(**{**PIVOT, "length": length})
        if length > 60 * mm:
            scene.link("more")
            scene.leaf(
                "tip", "more", start=(0.05, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(1 * mm, 10 * mm), material=STEEL,
                width_axis="z",
            )  # fmt: skip
        return scene

    with pytest.raises(ksd.SceneError, match=r"changes what the mechanism consists of"):
        ksd.gradient(growing, {"length": 60 * mm}, turn=0.1, questions="force")


def test_1_effects_are_those_of_the_pose():
    def warm(thickness, heat):
        scene = pivot(**{**PIVOT, "thickness": thickness})
        scene.consider("plate", "warping")
        if heat:
            scene.load("tip", force=(0, 0, heat), at=(0.04, 0, 0), following=heat > 1.0)
        return scene

    at_design = {"thickness": 0.4 * mm, "heat": 1.0}
    found = ksd.gradient(warm, at_design, turn=0.3, questions=("force", "support_stiffness"))
    # a load that follows on one side alone is an effect: held as it is at the pose
    assert np.isfinite(found["support_z_N_per_m", "heat"]).all()
    pose = ksd.solve(warm(**at_design), turn=0.3)
    # plate stiffening changes with the curvature and the thickness: against solves of neighbouring designs
    h = 1e-4 * at_design["thickness"]
    sides = [
        ksd.solve(warm(at_design["thickness"] + s, 1.0), turn=0.3, method="conventional").forces["turn"]
        for s in (h, -h)
    ]
    slope = (sides[0] - sides[1]) / (2 * h)
    assert found["turn_moment_Nm", "thickness"] == pytest.approx(slope, rel=1e-5)
    assert choose_effects(warm(**at_design).scene(), pose.model.mesh)["plate"].present


def wide(length, width, payload):
    """A pivot of wide leaf springs, whose plate factors change with their curvature."""
    scene = pivot(**{**PIVOT, "length": length, "width": width, "force": payload})
    scene.consider("plate")
    return scene


WIDE = {"length": 60 * mm, "width": 12 * mm, "payload": 2.0}


def test_plate_factors_follow_the_parameters():
    """Whole solves with factors converged to 1e-10; with the factors of the pose that of the moment by length is 2 % off."""
    words = {"turn": 0.35, "questions": ("force", "support_stiffness", "frequencies"), "accuracy": 1e-9}
    found = ksd.gradient(wide, WIDE, method="conventional", **words)
    for name, count in (("length", 12), ("width", 12)):
        assert compare(found, resolved(wide, WIDE, name, **words), name, WIDE) >= count
    by_load_and_drive = ksd.gradient(
        wide, WIDE, by=("payload_force_z", "turn"), **{**words, "questions": "force"}
    )
    for name, turn, payload, h in (("turn", 1e-3, 0.0, 1e-3), ("payload_force_z", 0.0, 1e-2, 1e-2)):
        one, other = (
            ksd.solve(wide(**{**WIDE, "payload": 2.0 + s * payload}), turn=0.35 + s * turn, accuracy=1e-9)
            for s in (1, -1)
        )
        slope = (one.forces["turn"] - other.forces["turn"]) / (2 * h)
        assert by_load_and_drive["turn_moment_Nm", name][0] == pytest.approx(slope, rel=1e-4)


def test_2_every_leaf_has_its_stress_where_two_are_equal():
    """With inner = 2 outer widths both leaf springs have one stress at any turn: the largest has a kink, each of them
    none."""
    found = ksd.gradient(cross, CROSS, turn=0.5, questions="stress", errors=True)
    leaves = [c for c in found.columns if c.startswith("stress_MPa[")]
    assert len(leaves) == 3 and found.values["stress_MPa"] == max(found.values[c] for c in leaves)
    assert all(np.all(found.errors[c, "inner"] <= 1e-5 * found.values[c] / CROSS["inner"]) for c in leaves)
    one = found["stress_MPa[hinge/inner]", "inner"] * CROSS["inner"] / found.values["stress_MPa"]
    others = [found[c, "inner"] * CROSS["inner"] / found.values[c] for c in leaves if "inner" not in c]
    assert all(abs(one - other) > 1e-4 for other in others)

    def stress(p, leaf):
        return p.stress()[leaf].largest_Pa * 1e-6

    for leaf in ("hinge/inner", leaves[-1][len("stress_MPa[") : -1]):
        h = 1e-3
        plus, minus = (
            ksd.solve(cross(**{**CROSS, "inner": 30 * mm * (1 + s)}), turn=0.5, method="full")
            for s in (h, -h)
        )
        slope = (stress(plus, leaf) - stress(minus, leaf)) / (2 * h * 30 * mm)
        np.testing.assert_allclose(
            found[f"stress_MPa[{leaf}]", "inner"],
            slope,
            rtol=1e-3,
            atol=1e-3 * found.values["stress_MPa"][0] / 0.03,
        )


def test_names_with_the_words_of_other_columns_have_gradients():
    """Answers of what is named "machined" or "stable_error" had none, and a job took its slopes as zero."""

    def machined(thickness):
        scene = ksd.Mechanism("machined")
        stage = scene.link("stage")
        scene.leaf("ground", stage, start=(0, 0, 0), end=(60 * mm, 0, 0), material=STEEL, name="machined",
                   section=ksd.rectangle(thickness, 10 * mm))  # fmt: skip
        scene.actuate(stage, along="y", at=(60 * mm, 0, 0), name="stable_error")
        return scene

    found = ksd.gradient(
        machined, {"thickness": 0.3 * mm}, stable_error=0.1 * mm, questions=("force", "stress")
    )
    assert {"stable_error_force_N", "stress_MPa[machined]"} <= set(found.columns)
    # of small motions
    slopes = found.relative
    assert slopes["stable_error_force_N", "thickness"] == pytest.approx(3.0, rel=1e-3)
    assert slopes["stress_MPa[machined]", "thickness"] == pytest.approx(1.0, rel=1e-2)


def test_3_equal_principal_stiffnesses_each_have_a_slope():
    """Of a square rod one grows with the width, one with its cube; in their own order both had the mean of these."""

    def rod(width, thickness=2 * mm):
        scene = ksd.Mechanism("rod")
        stage = scene.link("stage")
        scene.leaf("ground", stage, start=(0, 0, 0), end=(60 * mm, 0, 0), material=STEEL,
                   section=ksd.rectangle(thickness, width))  # fmt: skip
        scene.actuate(stage, about="x", name="twist")
        return scene

    found = ksd.gradient(rod, {"width": 2 * mm}, twist=0.0, questions="support_stiffness").relative
    for column in ("support_worst_N_per_m", "support_worst_Nm_per_rad"):
        two = [float(found[c, "width"][0]) for c in (column, f"{column}[2]")]
        assert sorted(two) == pytest.approx([1.0, 3.0], rel=2e-2)


def test_3_equal_frequencies_each_have_a_slope():
    """Frequencies of two reeds meet where they are equal; sorted they would kink there."""

    def two(first, second):
        scene = ksd.Mechanism("two reeds")
        for name, length, y in (("one", first, 0.0), ("other", second, 0.1)):
            link = scene.link(name)
            scene.leaf(
                scene.ground, link, start=(0, y, 0), end=(length, y, 0), section=ksd.rectangle(1 * mm, 20 * mm),
                material=STEEL, width_axis="z", name=f"leaf {name}",
            )  # fmt: skip
        scene.actuate("one", along="x", at=(first, 0, 0), name="pull")
        return scene

    at_design = {"first": 100 * mm, "second": 100 * mm}
    found = ksd.gradient(two, at_design, pull=0.0, questions="frequencies", freed="pull", modes=2).relative
    pairs = {}
    for name in ("first", "second"):
        slopes = sorted(float(found[c, name][0]) for c in found.columns[:2])
        pairs[name] = slopes
        np.testing.assert_allclose(slopes, [-2.0, 0.0], atol=2e-3)
    assert set(pairs) == {"first", "second"}


def test_4_frequencies_that_veer_are_followed_in_small_steps():
    found = ksd.gradient(fourbar, FOURBAR, by="height", top=0.1, questions="frequencies")
    reference = resolved(fourbar, FOURBAR, "height", h=4e-4, top=0.1, questions="frequencies")
    assert compare(found, reference, "height", FOURBAR, bound=1e-5) > 2


def test_5_a_held_direction_has_no_gradient(of_pivot):
    with pytest.raises(ksd.KinematicsError, match=r"hold link 'tip' there, so it has no stiffness"):
        of_pivot["support_rz_Nm_per_rad", "length"]
    assert ("support_rz_Nm_per_rad", 0) in of_pivot.reasons


def test_6_points_of_links_move_not_the_reference_points_of_nodes():
    where = (20 * mm, 5 * mm, 0)
    words = {"by": "length", "turn": 0.4, "questions": "force", "link": "tip", "at": where}
    found, judged = (ksd.gradient(pivot, PIVOT, errors=errors, **words) for errors in (False, True))
    h = 1e-3 * PIVOT["length"]
    sides = [
        ksd.solve(pivot(**{**PIVOT, "length": PIVOT["length"] + s}), turn=0.4, method="full") for s in (h, -h)
    ]
    moved = (sides[0].displacement("tip", where) - sides[1].displacement("tip", where)) / (2 * h)
    np.testing.assert_allclose(found.point["length"][0, :3], moved, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(found.point["length"][0, 3:], 0.0, atol=1e-6)
    np.testing.assert_allclose(judged.point["length"], found.point["length"], rtol=1e-6, atol=1e-6)
    nodes = [side.motion.x[side.model.node_names.index("tip")] for side in sides]
    assert not np.allclose((nodes[0] - nodes[1]) / (2 * h), moved, rtol=1e-2)


def test_7_all_lengths_together_are_flat_for_ratios(of_pivot):
    """Limits that are ratios do not see the scale: the sum over lengths of a stress is zero, whose rows an optimiser
    sees."""
    row = np.array([of_pivot.relative["stress_MPa", p] for p in ("length", "thickness", "width")])
    assert np.abs(row.sum(axis=0)).max() < 1e-7 < np.abs(row).max()


def test_critical_load_factors_change_sign_through_infinity():
    """1/mu is linear in the drive where mu passes through infinity, at no stress."""
    found = ksd.gradient(pivot, PIVOT, by="turn", turn=[0.01, 0.02], questions="buckling")
    mu = found.values["buckling_negative"]
    np.testing.assert_allclose(
        found["buckling_negative", "turn"] * np.array([0.01, 0.02]) / mu, -1.0, atol=0.6
    )
    still = ksd.gradient(pivot, PIVOT, by="turn", turn=[0.0], questions=("force", "buckling"))
    with pytest.raises(ksd.KinematicsError, match=r"no finite number"):
        still["buckling_negative", "turn"]


def test_error_figures_stand_beside():
    found = ksd.gradient(
        cross, CROSS, turn=0.3, questions=("force", "support_stiffness", "stress"), errors=True
    )
    reference = resolved(cross, CROSS, "thickness", turn=0.3, questions=("force", "support_stiffness"))
    for column in ("turn_moment_Nm", "support_z_N_per_m"):
        slope, own = reference[column]
        figure = found.errors[column, "thickness"]
        assert abs(found[column, "thickness"] - slope) <= 3 * figure + 10 * own + 1e-9 * abs(slope)
        assert 0.0 < figure < 2e-6 * abs(slope)
    assert found.relative.errors["turn_moment_Nm", "thickness"] < 1e-7
    for printed, heading in (
        (found, "Gradient per SI unit at"),
        (found.errors, "Gradient per SI unit, errors at"),
        (found.relative, "Relative gradient [%/%] at"),
        (found.relative.errors, "Relative gradient [%/%], errors at"),
    ):
        assert str(printed).startswith(heading)
    with pytest.raises(ksd.SceneError, match=r"errors=True"):
        _ = ksd.gradient(cross, CROSS, turn=0.3, questions="force").errors


@pytest.mark.parametrize("plate", [False, True])
def test_the_error_figure_holds_the_mesh(plate):
    """Against the derivatives of a mesh of many more modes: parasitic rotations are up to 7e-4 off, differences 1e-8.

    With plate stiffening, which changes within a short length about the inflection of a guide, up to 2e-5 of the derivatives
    of forces, poses and stress by the thickness is not in the figure (docs/limits.md).
    """

    def guide(thickness, width):
        joint = ksd.ParallelGuide(STEEL, length=60 * mm, spacing=40 * mm, thickness=thickness, width=width)
        scene = single_joint(joint)
        scene.load("tip", force=(3.0, 1.0, 0.5), at=(60 * mm, 10 * mm, 10 * mm))
        if plate:
            scene.consider("plate")
        return scene

    at_design, words = {"thickness": 0.3 * mm, "width": 40 * mm}, {"turn": 10 * mm}
    words["questions"] = ("force", "parasitic", "frequencies", "stress")
    found = ksd.gradient(guide, at_design, errors=True, **words)
    fine = ksd.gradient(guide, at_design, mesh=ksd.Mesh(orders=(9, 8, 14), points=24), accuracy=1e-9, **words)
    told, off = found.error_slopes[..., 0], np.abs(found.slopes - fine.slopes)[..., 0]
    size = np.abs(fine.slopes[..., 0])
    seen = off > 1e-5 * size
    row = found.columns.index("parasitic_rx_mrad")
    assert seen.sum() >= 5 and np.all(off[row] > 5e-4 * size[row])
    if plate:
        own = [not c.endswith("_Hz") for c in found.columns]
        assert np.all((off <= 2 * told + 2e-5 * size)[own, 0])
        return
    np.testing.assert_allclose(told[seen], off[seen], rtol=0.1)
    assert np.all(off <= 2 * told + 1e-7 * size)


def test_a_kink_is_told_by_the_error_figure():
    def bent(thickness):
        return cross(**{**CROSS, "thickness": max(thickness, 0.4 * mm)})

    found = ksd.gradient(bent, {"thickness": 0.4 * mm}, turn=0.3, questions="force", errors=True)
    whole = 3 * found.values["turn_moment_Nm"] / (0.4 * mm)
    np.testing.assert_allclose(found["turn_moment_Nm", "thickness"], 0.5 * whole, rtol=0.05)
    np.testing.assert_allclose(found.errors["turn_moment_Nm", "thickness"], 0.5 * whole, rtol=0.05)


def test_a_parameter_of_zero_takes_a_size():
    def shifted(offset):
        scene = single_joint(
            ksd.CrossedPivot(STEEL, length=60 * mm, angle=45 * deg, thickness=0.4 * mm, width=20 * mm)
        )
        scene.load("tip", force=(0, 1.0, 0), at=(40 * mm, offset, 0))
        return scene

    for sizes in (None, {"offset": 10 * mm}):
        found = ksd.gradient(shifted, {"offset": 0.0}, sizes=sizes, turn=0.3, questions="force")
        # the lever of a force along y grows where the point turns: dM = -F dx/dtheta
        np.testing.assert_allclose(found["turn_moment_Nm", "offset"], np.sin(0.3), rtol=1e-5)


def test_the_print_shows_poses_values_and_slopes(of_pivot):
    text = str(of_pivot)
    assert "turn 0.4000" in text and "strain_energy_J" in text and "thickness" in text
    assert repr(of_pivot).count("\n") == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"by": "thicknes"}, "no gradient by 'thicknes'.*thickness"),
        ({"by": ("length", "tunr")}, "no gradient by 'tunr'.*turn"),
        ({"sizes": {"lenght": 1.0}}, "no gradient by 'lenght'.*length"),
        ({"questions": "stres"}, "question 'stres' is not known.*stress"),
        ({"at_design": {**PIVOT, "lenght": 1.0}}, "no parameter 'lenght'.*length"),
        ({"at_design": None}, "give their values"),
        ({"at_design": {**PIVOT, "thickness": -1.0}}, "cannot be built"),
        ({"turn": None}, "drive"),
        ({"trun": 0.1}, "'trun'"),
        ({"errors": 1}, "errors"),
        ({"link": "tipp"}, "tip"),
    ],
)
def test_wrong_words_are_told(change, message):
    words = {"at_design": PIVOT, "turn": 0.1, "questions": ("force", "support_stiffness"), **change}
    words = {n: v for n, v in words.items() if v is not None or n == "at_design"}
    with pytest.raises(ksd.SceneError, match=message):
        ksd.gradient(pivot, **words)


def test_more_wrong_words(of_pivot):
    with pytest.raises(
        ksd.SceneError, match=r"nothing to take a gradient by: name it, by=.*, of length, angle"
    ):
        ksd.gradient(pivot, PIVOT, by=(), turn=0.1)
    with pytest.raises(ksd.SceneError, match=r"no gradient of column 'stress_MP'.*stress_MPa"):
        of_pivot["stress_MP", "length"]
    with pytest.raises(ksd.SceneError, match=r"no gradient by 'lenth'.*length"):
        of_pivot["stress_MPa", "lenth"]
    with pytest.raises(ksd.SceneError, match=r"give a column and a parameter"):
        of_pivot["stress_MPa"]
    pose = ksd.solve(pivot(**PIVOT), turn=0.1)
    with pytest.raises(ksd.SceneError, match=r"needs the function"):
        pose.gradient(lambda p: p.forces["turn"], at_design=PIVOT)
    with pytest.raises(ksd.SceneError, match=r"is no number"):
        pose.gradient(lambda p: p.forces["turn"], by="name", design=pivot, at_design={**PIVOT, "name": "a"})

    def narrow(length):
        if length != 60 * mm:
            raise ValueError("60 mm alone")
        return pivot(**{**PIVOT, "length": length})

    with pytest.raises(ksd.SceneError, match=r"cannot be built at 0.06000.*60 mm alone"):
        ksd.gradient(narrow, {"length": 60 * mm}, turn=0.1, questions="force")


def test_leaf_springs_that_touch_have_gradients_by_their_widths():
    """A wider one beside it would not be built: only the design asked about is checked."""

    def touching(inner, spacing):
        joint = ksd.CrossFlexure(
            STEEL,
            length=70 * mm,
            angle=40 * deg,
            thickness=0.4 * mm,
            widths=(inner, 12 * mm),
            spacing=spacing,
        )
        scene = ksd.Mechanism("hinge")
        scene.actuate_joint(
            scene.join(scene.ground, scene.link("arm"), joint, at=(0, 0, 0), axis="z", toward="x"),
            name="turn",
        )
        return scene

    words = {"turn": 0.3, "by": "inner", "questions": ("force", "support_stiffness")}
    found = ksd.gradient(touching, {"inner": 30 * mm, "spacing": 21 * mm}, **words)
    apart = ksd.gradient(touching, {"inner": 30 * mm, "spacing": 21.01 * mm}, **words)
    for column in ("turn_moment_Nm", "support_z_N_per_m"):
        assert found[column, "inner"] == pytest.approx(apart[column, "inner"], rel=1e-2)
    with pytest.raises(ksd.SceneError, match="run through each other"):
        touching(30.01 * mm, 21 * mm)
    loose = ksd.Mechanism("loose")
    loose.link("arm")
    with without_whole_checks():
        loose.scene()
    with pytest.raises(ksd.SceneError):
        loose.scene()


def test_what_is_no_equilibrium_has_no_gradient(monkeypatch):
    pose = ksd.solve(pivot(**PIVOT), turn=0.3, method="modal", basis=ksd.ModalBasis())
    with pytest.raises(ksd.SceneError, match=r"reduced bodies"):
        pose.gradient(lambda p: p.forces["turn"], by="turn")
    pose = ksd.solve(pivot(**PIVOT), turn=0.3)
    far = perturbed.parameters_of(pose.model.scene, pose.targets, size=0.1, by="turn")
    monkeypatch.setattr(perturbed, "NEWTON_STEPS", 1)
    with pytest.raises(ksd.ConvergenceError, match=r"no gradient.*next to this pose, at another 'turn'"):
        perturbed.PerturbedEquilibria()(pose, far)
