"""Files for other programs: drawings (DXF) and bodies (STL, 3MF, STEP) of a configuration, in mm.

`ksd.Configuration.export` and `ksd export` call these by the ending of the file.
"""

from ksd.export.dxf import write_dxf
from ksd.export.files import export
from ksd.export.solids import write_bodies

__all__ = ["export", "write_bodies", "write_dxf"]
