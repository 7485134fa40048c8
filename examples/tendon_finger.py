"""How far does a tendon bend a finger of two flexures, and how hard does it press?

Two phalanges on steel flexures of 20 x 10 x .3 mm; a tendon runs 5 mm beside them through three guides without friction. So
both flexures turn alike, and the tension is the change of the strain energy by the length wound up (Castigliano).
"""

import ksd
from ksd.units import GPa, mm

steel = ksd.Material(E=200 * GPa, nu=0.3, yield_stress=1.6 * GPa)
section = ksd.rectangle(0.3 * mm, 10 * mm)
L, arm = 20 * mm, 5 * mm


def finger(wall=False):
    """The finger, with a wall beside its tip or without."""
    scene = ksd.Mechanism("finger", plane="xy")
    middle, tip = scene.links("middle", "tip")
    scene.leaf(
        scene.ground, middle, start=(0, 0, 0), end=(L, 0, 0), section=section, material=steel, name="first"
    )
    scene.leaf(
        middle, tip, start=(2 * L, 0, 0), end=(3 * L, 0, 0), section=section, material=steel, name="second"
    )
    guides = [(scene.ground, (0, arm, 0)), (middle, (L, arm, 0)), (middle, (2 * L, arm, 0))]
    scene.cable(scene.ground, tip, start=(-L, arm, 0), end=(3 * L, arm, 0), via=guides, name="tendon")
    pad = scene.surface(tip, ksd.shapes.disc(4 * mm), at=(4 * L, 0, 0), name="pad")
    if wall:
        face = scene.surface(
            scene.ground, ksd.shapes.wall(), at=(65 * mm, 30 * mm, 0), axis="-y", name="wall"
        )
        scene.contact(pad, face, friction=0.4, name="touch")
    return scene


bent = ksd.solve(finger(), tendon=4 * mm)
turns = [float(bent.rotation(link)[2]) for link in ("middle", "tip")]
tension = bent.cables["tendon"].force
energy = [sum(ksd.solve(finger(), tendon=w * mm).strain_energy().values()) for w in (3.99, 4.01)]
castigliano = tension / ((energy[1] - energy[0]) / (0.02 * mm))
alike = turns[1] / turns[0]
walk = ksd.walk(finger(wall=True), [{"tendon": 3 * mm}, {"tendon": 6 * mm}], steps=6)
press = walk[-1].contacts["touch"].N


def picture(path=None):
    """The finger against the wall."""
    return walk[-1].plot(path)


print(f"wound up by 4 mm: turns of {turns[0]:.4f} and {turns[1]:.4f} rad, tension {tension:.3f} N")
print(f"tension over the change of energy {castigliano:.6f}")
for pose in walk:
    touch = pose.contacts["touch"]
    print(f"{pose.cables['tendon'].force:7.3f} N pull, {touch.N:.3f} N on the wall, {touch.state}")

if __name__ == "__main__":
    picture("tendon_finger.png")
