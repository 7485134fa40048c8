"""Orientation and slope along strain-mode leaves by Magnus steps, for pictures and section forces."""

from __future__ import annotations

import math

import numpy as np

from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_exp


@kernel
def integrate_centrelines(kappa, compliance, force, step, start, R, v):
    """Write R (k, m+1, 3, 3) and v = r' (k, m+1, 3) after each of m steps of length step (k,) [m] along k leaf springs.

    kappa (k, 2 m, 3) [1/m]: curvature at the first Gauss point of every step, then at the second; compliance (k, m+1,
    3) [1/N]: of stretch and shear, force (k, m+1, 3) [N], at the ends of the steps; start (k, 3, 3): R before the
    first. Magnus steps of fourth order; r' = R (e1 + C R^T n).
    """
    turn, E, local = np.empty(3), np.empty((3, 3)), np.empty(3)
    steps = kappa.shape[1] // 2
    for leaf in range(len(kappa)):
        h = step[leaf]
        f = math.sqrt(3.0) / 12.0 * h * h
        for g in range(steps + 1):
            here = R[leaf, g]
            if g == 0:
                for i in range(3):
                    for j in range(3):
                        here[i, j] = start[leaf, i, j]
            else:
                one, two, last = kappa[leaf, g - 1], kappa[leaf, steps + g - 1], R[leaf, g - 1]
                for c in range(3):
                    i, j = (c + 1) % 3, (c + 2) % 3
                    turn[c] = 0.5 * h * (one[c] + two[c]) + f * (one[i] * two[j] - one[j] * two[i])
                rotation_exp(turn, E)
                for i in range(3):
                    for j in range(3):
                        here[i, j] = last[i, 0] * E[0, j] + last[i, 1] * E[1, j] + last[i, 2] * E[2, j]
            for c in range(3):
                local[c] = compliance[leaf, g, c] * (
                    here[0, c] * force[leaf, g, 0]
                    + here[1, c] * force[leaf, g, 1]
                    + here[2, c] * force[leaf, g, 2]
                )
            for i in range(3):
                v[leaf, g, i] = (
                    here[i, 0] + here[i, 0] * local[0] + here[i, 1] * local[1] + here[i, 2] * local[2]
                )


@kernel
def strains_at(value, number, inner, s, kappa, soft):
    """Write curvature kappa (n, 3) [1/m] about e1, e2, e3, and compliance soft (n, 3) [1/N] of stretch and shear, of a
    strain-mode leaf at fractions s (n,) in 0..1 of its length: polynomials through their values at the quadrature points
    of each panel.

    value, number: constants and settings of `ksd.elements.strain_values`; inner: begins with the amplitudes.
    """
    ng, total = number[3], number[0] + number[1] + number[2]
    weight = 1 + number[0] ** 2 + number[1] ** 2 + number[2] ** 2 + total
    integral = weight + ng
    basis = integral + ng * ng
    compliance = basis + total * ng
    points, bends = np.zeros(ng), np.zeros((ng, 3))
    for g in range(ng):
        for j in range(ng):
            points[g] += value[integral + g * ng + j]
        mode = 0
        for c in range(3):
            for _ in range(number[c]):
                bends[g, c] += inner[mode] * value[basis + mode * ng + g]
                mode += 1
    kappa[:] = 0.0
    soft[:] = 0.0
    first, begin = 0, 0.0
    while first < ng:
        # integrals up to a point need no points of later panels
        last, crosses = first, True
        while crosses:
            last += 1
            crosses = False
            for g in range(last):
                for j in range(last, ng):
                    crosses = crosses or value[integral + g * ng + j] != 0.0
        end = begin
        for g in range(first, last):
            end += value[weight + g]
        for n in range(len(s)):
            if (s[n] >= begin or first == 0) and (s[n] < end or last == ng):
                for g in range(first, last):
                    share = 1.0
                    for j in range(first, last):
                        if j != g:
                            share *= (s[n] - points[j]) / (points[g] - points[j])
                    for c in range(3):
                        kappa[n, c] += share * bends[g, c]
                        soft[n, c] += share * value[compliance + 3 * g + c]
        first, begin = last, end


@kernel
def follow_centreline(value, number, inner, force, begin, end, steps, place, axes):
    """Take place (3,) [m] and axes (3, 3) of the section at fraction `begin` of a strain-mode leaf along to fraction `end`,
    in place, by `steps` Magnus steps of two halves; force (3,) [N]: constant along the leaf."""
    half = 2 * steps
    span, h = (end - begin) / half, value[0] * (end - begin) / half
    gauss = span / (2.0 * math.sqrt(3.0))
    points, ends = np.empty(2 * half), np.empty(half + 1)
    for k in range(half):
        ends[k] = begin + k * span
        points[k] = ends[k] + 0.5 * span - gauss
        points[half + k] = ends[k] + 0.5 * span + gauss
    ends[half] = end
    kappa, unused = np.empty((1, 2 * half, 3)), np.empty((2 * half, 3))
    bends, soft = np.empty((half + 1, 3)), np.empty((1, half + 1, 3))
    strains_at(value, number, inner, points, kappa[0], unused)
    strains_at(value, number, inner, ends, bends, soft[0])
    start, pull = np.empty((1, 3, 3)), np.empty((1, half + 1, 3))
    start[0] = axes
    for k in range(half + 1):
        pull[0, k] = force
    R, v = np.empty((1, half + 1, 3, 3)), np.empty((1, half + 1, 3))
    integrate_centrelines(kappa, soft, pull, np.full(1, h), start, R, v)
    for k in range(0, half, 2):
        for c in range(3):
            place[c] += h / 3.0 * (v[0, k, c] + 4.0 * v[0, k + 1, c] + v[0, k + 2, c])
    axes[:] = R[0, half]
