"""Packaging of what pyproject.toml cannot say beside a search for packages: `database/` is installed as ksd/database."""

from setuptools import find_packages, setup

setup(packages=[*find_packages(include=["ksd*"]), "ksd.database"], package_dir={"ksd.database": "database"})
