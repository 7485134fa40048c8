"""Open chains of random joints, driven at their joints or at their tip, and what their answers are held against."""

from typing import NamedTuple

import numpy as np

import ksd
from ksd.answers.buckling import buckling, twice_finer_state
from ksd.answers.finer_model import finer_state
from ksd.answers.frequencies import frequencies
from ksd.answers.leaf_groups import leaf_groups
from ksd.answers.mass import assemble_inertia as inertia_of
from ksd.answers.stiffness import drive_stiffness, point_stiffness
from ksd.answers.tangent import assemble_and_factor, assemble_tangent, factor_tangent
from ksd.answers.uncondensed import uncondensed_tangents
from ksd.errors import KsdError
from ksd.numerics.indefinite import equilibration, negative_inertia, solve_scaled
from ksd.scene.families.universal import UniversalJoint
from ksd.solvers.conventional import solve_conventional
from ksd.training.catalogue import FAMILY_DESIGNS, design_of

STEEL = ksd.Material(E=200e9, G=76.9e9, density=7850.0)
FAMILIES = tuple(FAMILY_DESIGNS)


class Arm(NamedTuple):
    """A mechanism, values of its drives, and its last link."""

    scene: ksd.Mechanism
    targets: dict[str, float]
    tip: str


def three_universal(drives=True):
    """Three universal joints in series, every axis driven."""
    joint, scene = UniversalJoint(STEEL, length=0.1, thickness=3e-4, width=0.04), ksd.Mechanism("three")
    before, x = scene.ground, 0.0
    for name, link in zip("abc", scene.links("one", "two", "three"), strict=True):
        scene.join(before, link, joint, at=(x, 0, 0), axis="z", toward="x", name=name)
        before, x = link, x + joint.length_AB + 0.1
        for motion in joint.motions if drives else ():
            scene.actuate_joint(name, name=f"{name} {motion.name}", motion=motion.name)
    return scene


def random_joint(rng, families=FAMILIES):
    """A joint of a family at a random shape of its trained range, of steel with a density."""
    design = design_of(str(rng.choice(families)))
    joint = design.make(**design.shape(rng.uniform(-1, 1, len(design.parameters))))
    return type(joint)(
        STEEL, **{k: v for k, v in vars(joint).items() if k != "material" and not k.startswith("_")}
    )


def random_arm(rng, *, joints=None, families=FAMILIES, drives=None, share=0.5):
    """An arm whose joints turn by up to `share` of their range; drives: "joints", "some" of them, or "tip"."""
    count = joints or int(rng.integers(1, 7))
    drives = drives or str(rng.choice(["joints", "some", "tip"]))
    scene, at, targets = ksd.Mechanism("arm"), np.zeros(3), {}
    before = scene.ground
    for k in range(count):
        joint, link = random_joint(rng, families), scene.link(f"link {k}")
        toward, axis = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
        if rng.random() < 0.5:
            toward, axis = np.eye(3)[rng.permutation(3)[:2]] * rng.choice([-1, 1], (2, 1))
        placed = scene.join(before, link, joint, at=at, axis=axis, toward=toward, name=f"joint {k}")
        at = placed.place(np.asarray(joint.pose_B)) + rng.uniform(-0.2, 0.2, 3)
        before = link
        for motion in joint.motions:
            low, high = motion.range
            name = f"{k} {motion.name}"
            if drives == "joints" or (drives == "some" and (not targets or rng.random() < 0.5)):
                scene.actuate_joint(placed, name=name, motion=motion.name)
                targets[name] = float(rng.uniform(share * low, share * high))
    if drives == "tip":
        for axis in rng.permutation(list("xyz"))[: int(rng.integers(1, min(3, count) + 1))]:
            scene.actuate(before, along=str(axis), at=at, name=f"tip {axis}")
            targets[f"tip {axis}"] = float(rng.uniform(-0.004, 0.004))
    return Arm(scene, targets, f"link {count - 1}")


def series(rng, families, share=0.8):
    """Joints of `families` one behind the other along x, their axes z, every axis driven by up to `share` of its range."""
    scene, x, targets = ksd.Mechanism("series"), 0.0, {}
    before = scene.ground
    for k, family in enumerate(families):
        joint, link = random_joint(np.random.default_rng(k), (family,)), scene.link(f"link {k}")
        placed = scene.join(before, link, joint, at=(x, 0, 0), axis="z", toward="x", name=f"joint {k}")
        before, x = link, x + float(joint.pose_B[0]) + 0.1
        for motion in joint.motions:
            low, high = motion.range
            scene.actuate_joint(placed, name=f"{k} {motion.name}", motion=motion.name)
            targets[f"{k} {motion.name}"] = float(rng.uniform(share * low, share * high))
    return Arm(scene, targets, f"link {len(families) - 1}")


def differences(found, step=4e-3):
    """Drive stiffness (d, d) of a configuration by differences of equilibria, of fourth order in their step; drives in their
    order."""
    model, names = found.model, found.model.drive_names
    columns = []
    for name in names:
        size = step * (1.0 if "tip" not in name else 0.1)

        def forces(times, name=name, size=size):
            values = {**found.targets, name: found.targets[name] + times * size}
            moved = solve_conventional(model, values, start=found, planar=False, rtol=1e-12)
            return np.array([moved.forces[n] for n in names])

        near, far = forces(1) - forces(-1), forces(2) - forces(-2)
        columns.append((8 * near - far) / (12 * size))
    return np.array(columns).T


def stiffness_error(found, steps=(4e-3, 5e-4)):
    """Error of the drive stiffness of a configuration (mesh as it is), over the diagonal entries beside it, against
    differences: the largest of the better of the steps, one spoilt by what they leave out, the other by rounding."""
    tangent = assemble_and_factor(found.model, found.motion)
    own = drive_stiffness(found.model, found.motion, tangent=tangent).matrix
    errors = []
    for step in steps:
        exact = differences(found, step)
        scale = np.sqrt(np.abs(np.diagonal(exact)))
        errors.append(np.abs((own - exact) / np.outer(scale, scale)))
    return float(np.min(errors, axis=0).max())


def no_minimum(refusal):
    """Whether the state of a TrustError has as many negative eigenvalues as it says, counted with pivoting, and too many."""
    state = refusal.result
    assembled = assemble_tangent(state.model, state.motion)
    return (
        negative_inertia(assembled.matrix()) + assembled.inner_negatives
        == state.negatives
        > state.expected_negatives
    )


def pivoted_errors(found, tip):
    """Largest errors of drive stiffness and of the compliance of `tip`, over their own diagonal, against partial pivoting
    with two refinements."""
    model, motion = finer_state(*found.unreduced_state)
    assembled = assemble_tangent(model, motion)
    tangent, K = factor_tangent(assembled), assembled.matrix()
    rows, node = model.arrays.terms.start, model.node_names.index(tip)
    columns = np.concatenate([rows, model.arrays.start[node] + np.arange(6)])
    loads, scale = np.zeros((len(K), len(columns))), equilibration(K)
    loads[columns, np.arange(len(columns))] = 1.0
    x = np.zeros_like(loads)
    for _ in range(3):
        rest = (loads.astype(np.longdouble) - K.astype(np.longdouble) @ x.astype(np.longdouble)).astype(float)
        x = x + solve_scaled(K, rest, scale)[0]
    d = len(model.drive_names)
    errors = []
    for own, exact in (
        (drive_stiffness(model, motion, tangent=tangent).matrix, -x[rows[:d], :d]),
        (
            point_stiffness(model, motion, tip, tangent=tangent).compliance,
            x[columns[len(rows) :], len(rows) :],
        ),
    ):
        size = np.sqrt(np.abs(np.diagonal(exact)))
        # directions that are held have none
        size = np.maximum(size, 1e-9 * size.max())
        errors.append(float(np.abs((own - exact) / np.outer(size, size)).max(initial=0.0)))
    return errors


def _free(model, K):
    """Columns that span the motions the constraint rows of K (n, n) leave."""
    rows = model.arrays.terms.start
    move = np.setdiff1d(np.arange(len(K)), rows)
    free = np.zeros((len(K), len(move) - len(rows)))
    free[move] = np.linalg.svd(K[np.ix_(rows, move)])[2][len(rows) :].T
    return free


def frequency_error(found, count=4):
    """Largest relative error of the lowest frequencies, drives held, against all eigenvalues in the span of free motions."""
    from scipy.linalg import block_diag, eigh

    model, motion = finer_state(*found.unreduced_state)
    mass, K = inertia_of(model, motion), assemble_tangent(model, motion).matrix()
    free = _free(model, K)
    # G with K^-1 = G G^T: of the free motions, and of every leaf
    roots = [np.linalg.solve(np.linalg.cholesky(free.T @ K @ free), free.T).T]
    places = [np.arange(len(K))]
    for inner, Z in (*((leaf.inner, leaf.Z) for leaf in mass.leaves), *mass.bubbles):
        values, vectors = np.linalg.eigh(Z)
        roots += list(vectors * np.sqrt(np.maximum(values, 0.0))[:, None])
        places += list(inner)
    G = block_diag(*roots)
    moved = G.T @ mass.matrix.toarray()[np.ix_(np.concatenate(places), np.concatenate(places))] @ G
    size = len(moved)
    largest = eigh(moved, eigvals_only=True, subset_by_index=(size - count, size - 1))[::-1]
    exact = 1.0 / np.sqrt(largest) / (2 * np.pi)
    own = frequencies(*found.unreduced_state, count=count).frequency_Hz
    return float(np.abs(own / exact - 1.0).max())


def buckling_error(found, count=2):
    """Largest relative error of the smallest critical load factors on the state's own stresses, against all eigenvalues of
    1 + mu C K' + mu^2 C K'', C the flexibility without stress of the motions and amplitudes that stress acts on; K' and K''
    from the tangents with all stresses once and twice."""
    model, motion = twice_finer_state(*found.unreduced_state)
    stressed, K = (part.toarray() for part in uncondensed_tangents(model, motion))
    inner = motion.inner.copy()
    for group in leaf_groups(model):
        inner[group.inner_index[:, group.modes :]] *= 2.0
    twice = motion._replace(inner=inner, multiplier=2.0 * motion.multiplier)
    doubled = uncondensed_tangents(model, twice, load_factor=2.0)[0].toarray()
    change, curvature = 2.0 * stressed - 0.5 * doubled - 1.5 * K, 0.5 * doubled - stressed + 0.5 * K
    used = np.flatnonzero(change.any(axis=0))
    scale = equilibration(K)
    flexible = solve_scaled(K, np.eye(len(K))[:, used], scale)[0][used] / scale[used, None]
    A, B = (flexible @ part[np.ix_(used, used)] * scale[used] for part in (change, curvature))
    # 1/mu of the quadratic problem
    values = np.linalg.eigvals(np.block([[-A, -B], [np.eye(len(A)), np.zeros_like(A)]]))
    exact = 1.0 / values[np.argsort(-np.abs(values))[: 2 * count]]
    own = buckling(*found.unreduced_state, count=count).factor
    own = own[np.argsort(np.abs(own))][:count]
    # factors of the same size and either sign come in any order
    nearest = np.abs(own[:, None] / exact - 1.0).min(axis=1)
    return float(max(nearest.max(), np.abs(np.abs(own) / np.abs(exact[:count]) - 1.0).max()))


def solved(scene, targets, **options):
    """The answer, or the error it is refused with."""
    try:
        return ksd.solve(scene, targets, **options)
    except KsdError as error:
        return error
