"""A small record with known functions: two shape parameters, one rotation, one internal block, two leaf springs."""

import numpy as np
import pytest

from ksd.library import Evidence, Functions, Parameter, Probes, Record, Residual, Stroke


@pytest.fixture
def record() -> Record:
    rng = np.random.default_rng(0)
    powers = np.array([[p, a, b] for p in range(5) for a in range(3) for b in range(2)])
    M = len(powers)

    def table(*shape: int) -> np.ndarray:
        return 0.05 * rng.standard_normal((*shape, M))

    strain = Functions(table(6), table(1, 6), amplitudes=table(2, 12), wrench=table(2, 6))
    return Record(
        family="toy",
        motions=(Stroke("angle", "rotation", -1.2, 1.2),),
        parameters=(Parameter("angle", 0.5, 1.0), Parameter("ratio", 0.25, 4.0, "log")),
        leaves=("one", "two"),
        blocks=("middle",),
        orders=(4, 3, 5),
        powers=powers,
        functions={2: Functions(table(6), table(1, 6), rotations=table(2, 3, 3)), "strain": strain},
        residuals=(
            Residual("strain", "interface", 1e-6, 5e-7, 2e-6, 1e-6),
            Residual(2, "interface", 1e-6, 5e-7, 3e-6, 1e-6),
        ),
        evidence=(Evidence("thickness", "0.5 times", 1e-5, 5e-5),),
        design={"length": 0.1, "thickness": 1e-3},
        samples=(64, 8),
        trained="2024-01-01",
        version="0.1.0",
        history=("trained",),
        probes=Probes(
            np.array([[0.6, 1.0], [0.8, 2.0]]), np.array([[-1.2], [0.4]]), rng.standard_normal((2, 78))
        ),
    )
