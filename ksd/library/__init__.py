"""Joint records, the results of training a joint family: one HDF5 file each; and files of results."""

from ksd.library.functions import Functions, JointFunctions, Mesh, monomials
from ksd.library.record import Evidence, Parameter, Probes, Record, Residual, Stroke
from ksd.library.record_files import (
    FORMAT,
    Listing,
    describe_database,
    find_record,
    read_record,
    record_folders,
    write_record,
)
from ksd.library.result_files import read_result

__all__ = [
    "FORMAT",
    "Evidence",
    "Functions",
    "JointFunctions",
    "Listing",
    "Mesh",
    "Parameter",
    "Probes",
    "Record",
    "Residual",
    "Stroke",
    "describe_database",
    "find_record",
    "monomials",
    "read_record",
    "read_result",
    "record_folders",
    "write_record",
]
