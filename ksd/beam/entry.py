"""C entry points of the leaf kernels: what assembly calls, so that it compiles without recompiling the leafs.

Every entry takes flat pointers and their lengths; see `ksd.beam.strain` and `ksd.beam.corotational` for the meaning.
`out` (4,) receives negative pivots, error force [N], error moment [Nm], status.
"""

from __future__ import annotations

from ksd.beam import corotational, corotational_near, modal, planar_leaf, polynomial, strain
from ksd.numerics.kernel import carray, late

_P = "CPointer(float64)"
_I = "CPointer(int64)"
_CONDENSE = f"void({_P}, {_I}, {_P}, {_P}, {_P}, {_P}, {_P}, {_P}, {_P}, {_I})"
_WITH_SCRATCH = f"void({_P}, {_I}, {_P}, {_P}, {_P}, {_P}, {_P}, {_P}, {_P}, {_P}, {_I})"
_RECOVER = f"void({_P}, {_I}, {_P}, {_P}, {_P}, float64, {_I})"


@late(_WITH_SCRATCH)
def strain_condense(value, number, inner, store, scratch, d, Q, lam, K, out, size):
    """size = lengths of value, inner, store, near, scratch."""
    back, force, moment, status = strain.strain_condense(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(scratch, (size[4],)), carray(d, (3,)), carray(Q, (3, 3)), carray(lam, (12,)), carray(K, (6, 6)),
    )  # fmt: skip
    out[0], out[1], out[2], out[3] = back, force, moment, status


@late(_RECOVER)
def strain_recover(value, number, inner, store, xi, scale, size):
    """Inner update of a strain-mode leaf."""
    strain.strain_recover(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(xi, (6,)), scale,
    )  # fmt: skip


@late(_CONDENSE)
def chain_condense(value, number, inner, store, d, Q, lam, K, out, size):
    """size = lengths of value, inner, store, near."""
    back, force, moment, status = corotational.condense(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(d, (3,)), carray(Q, (3, 3)), carray(lam, (12,)), carray(K, (6, 6)),
    )  # fmt: skip
    out[0], out[1], out[2], out[3] = back, force, moment, status


@late(f"void({_P}, {_I}, {_P}, {_P}, {_P}, {_P}, {_P}, {_P}, {_P}, {_P}, {_I})")
def chain_near(value, number, inner, store, near, d, Q, lam, K, out, size):
    """A chain linearised about its element orientations `near`; size = lengths of value, inner, store, near."""
    back, force, moment, status = corotational_near.near_condense(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(near, (size[3],)), carray(d, (3,)), carray(Q, (3, 3)), carray(lam, (12,)), carray(K, (6, 6)),
    )  # fmt: skip
    out[0], out[1], out[2], out[3] = back, force, moment, status


@late(_RECOVER)
def chain_recover(value, number, inner, store, xi, scale, size):
    """Inner update of a chain."""
    corotational.recover(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(xi, (6,)), scale,
    )  # fmt: skip


@late(_CONDENSE)
def planar_condense(value, number, inner, store, d, Q, lam, K, out, size):
    """A leaf that bends in its plane; size = lengths of value, inner, store."""
    back, force, moment, status = planar_leaf.condense(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(d, (3,)), carray(Q, (3, 3)), carray(lam, (12,)), carray(K, (6, 6)),
    )  # fmt: skip
    out[0], out[1], out[2], out[3] = back, force, moment, status


@late(_RECOVER)
def planar_recover(value, number, inner, store, xi, scale, size):
    """Inner update of a leaf that bends in its plane."""
    planar_leaf.recover(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(xi, (6,)), scale,
    )  # fmt: skip


@late(_CONDENSE)
def modal_condense(value, number, inner, store, d, Q, lam, K, out, size):
    """size = lengths of value, inner, store, near."""
    back, force, moment, status = modal.modal_condense(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(d, (3,)), carray(Q, (3, 3)), carray(lam, (12,)), carray(K, (6, 6)),
    )  # fmt: skip
    out[0], out[1], out[2], out[3] = back, force, moment, status


@late(_CONDENSE)
def polynomial_condense(value, number, inner, store, d, Q, lam, K, out, size):
    """size = lengths of value, inner, store, near."""
    back, force, moment, status = polynomial.polynomial_condense(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(d, (3,)), carray(Q, (3, 3)), carray(lam, (12,)), carray(K, (6, 6)),
    )  # fmt: skip
    out[0], out[1], out[2], out[3] = back, force, moment, status


@late(_RECOVER)
def modal_recover(value, number, inner, store, xi, scale, size):
    """Inner update of a modal or a polynomial body."""
    modal.modal_recover(
        carray(value, (size[0],)), carray(number, (4,)), carray(inner, (size[1],)), carray(store, (size[2],)),
        carray(xi, (6,)), scale,
    )  # fmt: skip
