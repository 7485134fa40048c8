"""How far must the motors of a delta stage turn, and does its platform stay level?

Three legs of a hinge, an arm, a universal joint, a rod and a universal joint carry a platform
(`ksd/scenes/delta_stage.toml`). For rigid links and ideal joints the hinge angles are intersections of circles; the
leaf springs change them only slightly.
"""

from pathlib import Path

import numpy as np

import ksd
from ksd.units import deg, mm, mrad

target = np.array((5, 3, 4)) * mm

mechanism, _, _ = ksd.load_scene(Path(ksd.__file__).parent / "scenes" / "delta_stage.toml")
pose = ksd.solve(mechanism, dict(zip("xyz", target, strict=True)))
angles = [float(pose.motions[f"base {k + 1}"]) for k in range(3)]
tilt = float(np.linalg.norm(pose.rotation("platform")))

# rigid links, in the plane of each leg: centres of the hinge, of the lower and of the upper universal joint
step = 50 * mm / np.sqrt(2)
lean = np.array((-0.4, 0, 0.916515138991168))  # of the rods
hinge = np.array((100 * mm + step / 2, 0, 0))
lower = np.array((200 * mm, 0, 0)) + step * lean
upper = np.array((100 * mm, 0, 229.128785 * mm)) - step * lean
arm, rod = lower - hinge, np.linalg.norm(upper - lower)
rigid = []
for k in range(3):
    c, s = np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3)
    to = upper + np.array(((c, s, 0), (-s, c, 0), (0, 0, 1))) @ target - hinge
    # |to - arm| = rod, with the arm rotated by the hinge angle; of two solutions the smaller angle
    a, b = to[0] * arm[0] + to[2] * arm[2], to[0] * arm[2] - to[2] * arm[0]
    reach = (to @ to + arm @ arm - rod**2) / 2
    both = np.arctan2(b, a) + np.arccos(reach / np.hypot(a, b)) * np.array((-1, 1))
    rigid.append(float(both[np.argmin(np.abs(both))]))
first, second, third = angles
off = float(max(abs(q - r) for q, r in zip(angles, rigid, strict=True)))


def picture(path=None):
    """The moved stage over the one at rest."""
    return pose.plot(path)


print("hinges turn by", *(f"{q / deg:.4f}" for q in angles), "degrees")
print("rigid links   ", *(f"{r / deg:.4f}" for r in rigid), "degrees")
print(f"largest difference {off / mrad:.3f} mrad; the platform tilts by {tilt / mrad:.3f} mrad")

if __name__ == "__main__":
    picture("delta_stage.png")
