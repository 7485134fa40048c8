"""The description of mechanisms: materials, joints, links, drives, loads. Imports numpy, and scipy for splines, alone."""

from ksd.scene.curve import Arc, Curve, FreeCurve
from ksd.scene.drive import GROUND, Drive, DriveTerm
from ksd.scene.families import joint_families, joint_family, make_joint
from ksd.scene.families.cartwheel import Butterfly, Cartwheel
from ksd.scene.families.constraints import FoldedLeaf, WireFlexure
from ksd.scene.families.cross_flexure import CrossFlexure
from ksd.scene.families.crossed_pivot import BalancedCrossedPivot, CrossedPivot
from ksd.scene.families.guide import ParallelGuide, StiffenedGuide
from ksd.scene.families.infinity import InfinityHinge, TripleInfinityHinge
from ksd.scene.families.notch import ArcHinge, CircularNotchHinge, FilletedNotchHinge
from ksd.scene.families.universal import UniversalJoint
from ksd.scene.joint import DrawnJoint, Joint, Motion
from ksd.scene.leaf import Leaf, wire
from ksd.scene.link import Link
from ksd.scene.load import Load, PointMass
from ksd.scene.material import Material
from ksd.scene.mechanism import Mechanism
from ksd.scene.profile import CircularNotch, FilletedNotch, Profile, StiffenedMiddle, Taper, Varying
from ksd.scene.scene import PlacedJoint, PlacedLeaf, Scene, joint_angle

__all__ = [
    "GROUND",
    "Arc",
    "ArcHinge",
    "BalancedCrossedPivot",
    "Butterfly",
    "Cartwheel",
    "CircularNotch",
    "CircularNotchHinge",
    "CrossFlexure",
    "CrossedPivot",
    "Curve",
    "DrawnJoint",
    "Drive",
    "DriveTerm",
    "FilletedNotch",
    "FilletedNotchHinge",
    "FoldedLeaf",
    "FreeCurve",
    "InfinityHinge",
    "Joint",
    "Leaf",
    "Link",
    "Load",
    "Material",
    "Mechanism",
    "Motion",
    "ParallelGuide",
    "PlacedJoint",
    "PlacedLeaf",
    "PointMass",
    "Profile",
    "Scene",
    "StiffenedGuide",
    "StiffenedMiddle",
    "Taper",
    "TripleInfinityHinge",
    "UniversalJoint",
    "Varying",
    "WireFlexure",
    "joint_angle",
    "joint_families",
    "joint_family",
    "make_joint",
    "wire",
]
