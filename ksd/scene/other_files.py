"""Files of other programs, recognised by their first bytes, for the message where one is given as a scene file."""

from __future__ import annotations

import re

HEAD_BYTES = 4096
"""Number of bytes by which a file is recognised."""
_BINARY = {
    b"\x89HDF": "an HDF5 file", b"%PDF": "a PDF document", b"\x89PNG": "a picture", b"\xff\xd8\xff": "a picture",
    b"MATLAB 5.0": "a MATLAB data file", b"\x93NUMPY": "a NumPy array", b"\x80\x04": "a Python pickle",
    b"\x80\x05": "a Python pickle", b"\x1f\x8b": "a gzip archive", b"\xd0\xcf\x11\xe0": "a CAD or office document",
}  # fmt: skip
_SUFFIXES = {
    ".mph": "a COMSOL model", ".slx": "a Simulink model", ".fcstd": "a FreeCAD document", ".3mf": "a 3MF model",
    ".xlsx": "an Excel workbook", ".npz": "an archive of NumPy arrays", ".sldprt": "a SolidWorks part",
    ".sldasm": "a SolidWorks assembly", ".ipt": "an Inventor part", ".iam": "an Inventor assembly",
    ".f3d": "a Fusion design",
    ".catpart": "a CATIA part", ".x_t": "a Parasolid file", ".x_b": "a Parasolid file", ".stl": "an STL mesh",
    ".dwg": "an AutoCAD drawing", ".db": "an ANSYS database", ".odb": "an Abaqus result", ".rst": "an ANSYS result",
}  # fmt: skip
"""Of formats that their first bytes alone do not tell."""
_TEXT = (
    (r"ISO-10303-21;", "a STEP file"),
    (r"solid\b[^\n]*\n\s*facet", "an STL mesh"),
    (r"[^\n]{72}S\s*1\s*$", "an IGES file"),
    (r"0\s*\n\s*SECTION\b", "a DXF drawing"),
    (r"(?:\$[^\n]*\n)*\*KEYWORD\b", "an LS-DYNA input file"),
    (r"(?:\*\*[^\n]*\n\s*)*\*(?:HEADING|NODE|PART|INCLUDE|MATERIAL|PREPRINT|PARAMETER|ELEMENT)\b",
     "an Abaqus or CalculiX input file"),
    (r"(?:![^\n]*\n\s*)*(?:/(?:BATCH|PREP7|TITLE|COM|CLEAR|CLE|FILNAME|NOPR|UNITS)\b|FINI(?:SH)?\b|ET,\s*\d|N,\s*\d|MP,)",
     "an ANSYS input file"),
    (r"(?:\$[^\n]*\n\s*)*(?:SOL\s+\w+\s*$|CEND\b|BEGIN\s+BULK|NASTRAN\b|ID\s+\w+,|GRID[\s,*]+\d)", "a Nastran input file"),
    (r"(?:%[^\n]*\n\s*)*(?:PL(?:BEAM|HINGE|TRUSS|TUBE|BELT|GEAR|PINBODY|SLIDER|RBEAM|WHEEL)|BEAMNS|BEAMW|BEAM|HINGE|TRUSS"
     r"|TUBE|SLIDER|RBEAM|PINBODY)\s+\d+\s+\d+", "a SPACAR input file"),
    (r"\$MeshFormat", "a Gmsh mesh"),
    (r"(?://[^\n]*\n\s*)*(?:SetFactory|Point\s*\()", "a Gmsh geometry"),
    (r"# vtk DataFile", "a VTK file"),
    (r"(?:#[^\n]*\n\s*)*(?:wipe\b|model\s+basic)", "an OpenSees script"),
    (r"ADAMS\b|(?:![^\n]*\n\s*)*(?:PART|MARKER)/\d|(?:![^\n]*\n\s*)*model\s+create", "an Adams model"),
    (r"(?:within\b|package\s+\w|(?:partial\s+)?model\s+\w+)", "a Modelica model"),
    (r"<(?:\?xml[^>]*>\s*<)?(?:!--.*?-->\s*<)?robot\b", "a robot description (URDF)"),
    (r"<(?:\?xml[^>]*>\s*<)?mujoco\b", "a MuJoCo model"),
    (r"<(?:\?xml[^>]*>\s*<)?VTKFile\b", "a VTK file"),
    (r"<", "an XML or HTML file"),
    (r"\{|\[\s*\{", "a JSON file"),
    (r"%YAML|---\s*$|[A-Za-z_][\w ]*:(?:\s|$)", "a YAML file"),
    (r"(?:#[^\n]*\n\s*)*(?:(?:import|from)\s+[A-Za-z_]|def\s+\w+\s*\(|\"\"\")", "a Python script"),
    (r"(?:%[^\n]*\n\s*)*(?:function\b|clear\b|clc\b|close\s+all\b)|%", "a MATLAB script"),
)  # fmt: skip
"""Regular expressions of how text files begin, in the order in which they are tried."""


def other_format(head: bytes, suffix: str) -> str:
    """What a file is, in words, from its first `HEAD_BYTES` and the suffix of its name; empty where that is not known."""
    suffix = suffix.lower() if head else ""
    if head.startswith(b"PK\x03\x04"):
        return _SUFFIXES.get(suffix, "a zip archive")
    found = next((words for start, words in _BINARY.items() if head.startswith(start)), "")
    if found:
        return _SUFFIXES.get(suffix, found)
    text = head.decode("latin-1").replace("\r\n", "\n").removeprefix("\xef\xbb\xbf")
    flags = re.IGNORECASE | re.MULTILINE | re.DOTALL
    for pattern, words in _TEXT:
        if re.match(pattern if pattern.startswith("[^") else rf"\s*(?:{pattern})", text, flags):
            return words
    rows = text.splitlines()[:2]
    if suffix == ".csv" or (
        len(rows) == 2 and rows[0].count(",") == rows[1].count(",") > 1 and "=" not in text
    ):
        return "a table of comma-separated values"
    return _SUFFIXES.get(suffix, "")
