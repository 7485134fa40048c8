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

__all__ = [
    "GROUND",
    "CrossFlexure",
    "DrawnJoint",
    "Drive",
    "DriveTerm",
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
    "Scene",
    "joint_angle",
    "joint_families",
    "joint_family",
    "make_joint",
    "wire",
]
