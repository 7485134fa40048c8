"""How does a job become a component of a larger system, as OpenMDAO calls it: inputs, outputs, partial derivatives?

`Pivot` has the methods setup, compute and compute_partials of an `openmdao.api.ExplicitComponent`, its base class in
OpenMDAO. A few Newton steps replace the system here: which thickness gives a crossed pivot 2 E w t^3/(12 L) = 1.5 Nm/rad?
"""

import ksd
from ksd.units import GPa, deg, mm

steel = ksd.Material(E=200 * GPa, nu=0.3)
length, width, wanted = 60 * mm, 20 * mm, 1.5


def pivot(thickness):
    """An arm on two leaf springs that cross in their middle."""
    joint = ksd.CrossedPivot(steel, length=length, angle=45 * deg, thickness=thickness, width=width)
    scene = ksd.Mechanism("pivot")
    arm = scene.link("arm")
    placed = scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x", name="pivot")
    scene.actuate_joint(placed, name="turn")
    return scene


class Pivot:
    """A job as an explicit component: every parameter an input, every answer an output."""

    def setup(self):
        """The job; in OpenMDAO also add_input and add_output for these names, declare_partials("*", "*")."""
        vary, goal = {"thickness": (0.2 * mm, 1 * mm)}, "turn_stiffness_Nm_per_rad"
        self.job = ksd.Job(pivot, vary=vary, turn=0.1 * deg, minimise=goal, extrapolate=True)
        self.inputs, self.outputs = self.job.parameters, self.job.names

    def compute(self, inputs, outputs):
        """Answers at the inputs."""
        outputs.update(zip(self.outputs, self.job.values([inputs[n] for n in self.inputs]), strict=True))

    def compute_partials(self, inputs, partials):
        """Derivatives of every output by every input."""
        slopes = self.job.jacobian([inputs[n] for n in self.inputs]).flat
        partials.update(zip([(o, i) for o in self.outputs for i in self.inputs], slopes, strict=True))


component, inputs, outputs, partials = Pivot(), {"thickness": 0.4 * mm}, {}, {}
component.setup()
goal = component.outputs[0], "thickness"
for _ in range(6):
    component.compute(inputs, outputs)
    component.compute_partials(inputs, partials)
    inputs["thickness"] += (wanted - outputs[goal[0]]) / partials[goal]
thickness = inputs["thickness"]
print(f"{outputs[goal[0]]:.6f} Nm/rad at a thickness of {thickness / mm:.5f} mm")


def picture(path=None):
    """The pivot, turned."""
    return ksd.solve(pivot(thickness), turn=10 * deg, extrapolate=True).plot(path)


if __name__ == "__main__":
    picture("job_as_component.png")
