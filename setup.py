"""Packages that hold files and no modules: the scenes, and `database/`, which is installed as ksd/database."""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["ksd*"]), "ksd.scenes", "ksd.database"],
    package_dir={"ksd.database": "database"},
)
