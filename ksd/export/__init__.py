"""Files for other programs: drawings (DXF), bodies (STL, 3MF, STEP), input of CalculiX (.inp) of a configuration, in mm.

`ksd.Configuration.export` and `ksd export` call these by the ending of the file.
"""

from ksd.export.calculix import write_deck
from ksd.export.calculix_run import confirm
from ksd.export.dxf import write_dxf
from ksd.export.files import export
from ksd.export.solids import write_bodies

__all__ = ["confirm", "export", "write_bodies", "write_deck", "write_dxf"]
