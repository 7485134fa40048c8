"""What the engineer says: materials, joints, links, drives, loads. Imports numpy alone."""

from ksd.scene.contents import PlacedJoint, PlacedLeaf, Scene, joint_angle
from ksd.scene.drive import GROUND, Drive, DriveTerm, Load, PointMass
from ksd.scene.families import joint_families, joint_family, make_joint
from ksd.scene.families.cross_flexure import CrossFlexure
from ksd.scene.joint import DrawnJoint, Joint, Motion
from ksd.scene.leaf import Leaf, wire
from ksd.scene.links import Link
from ksd.scene.material import Material
from ksd.scene.mechanism import Mechanism
from ksd.scene.profile import (
    Arc,
    CircularNotch,
    Curve,
    FilletedNotch,
    FreeCurve,
    Profile,
    StiffenedMiddle,
    Taper,
    Varying,
)

__all__ = [
    "GROUND",
    "Arc",
    "CircularNotch",
    "CrossFlexure",
    "Curve",
    "DrawnJoint",
    "Drive",
    "DriveTerm",
    "FilletedNotch",
    "FreeCurve",
    "Joint",
    "Leaf",
    "Link",
    "Load",
    "Material",
    "Mechanism",
    "Motion",
    "PlacedJoint",
    "PlacedLeaf",
    "PointMass",
    "Profile",
    "Scene",
    "StiffenedMiddle",
    "Taper",
    "Varying",
    "joint_angle",
    "joint_families",
    "joint_family",
    "make_joint",
    "wire",
]
