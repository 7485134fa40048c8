"""Scene files from files of other programs: centre lines of a drawing (DXF), input of SPACAR Light (MAT).

`ksd new NAME --from FILE` calls these by the ending of the file.
"""

from ksd.importing.dxf import read_dxf
from ksd.importing.spacar import read_spacar

__all__ = ["read_dxf", "read_spacar"]
