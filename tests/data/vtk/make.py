"""Writes the files of this folder with VTK (9.7): one cloud of 4 points in every encoding. Run in this folder."""

import re
import sys

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk

N = 4


def array(values, name, kind=None):
    out = numpy_to_vtk(values, deep=1, array_type=kind)
    out.SetName(name)
    return out


def fill(data, is_xml):
    # Few binary digits: text holds them in full.
    coordinates = np.arange(3 * N).reshape(N, 3).astype("f4") / 8 - 0.5
    points = vtk.vtkPoints()
    points.SetData(array(coordinates, "Points"))
    data.SetPoints(points)
    here = data.GetPointData()
    here.SetScalars(array((np.arange(3 * N).reshape(N, 3) * 23).astype("u1"), "rgb"))
    here.SetVectors(array(np.arange(3 * N).reshape(N, 3)[::-1] / 256.0 - 3, "my velocity"))
    here.SetGlobalIds(array(np.arange(N) * 1000 + 7, "ids", vtk.VTK_ID_TYPE))
    here.AddArray(array(np.array([-(2**63), 2**62, 0, -1]), "big"))
    label = vtk.vtkStringArray()
    label.SetName("a label")
    flag = vtk.vtkBitArray()
    flag.SetName("flag")
    for i in range(N):
        label.InsertNextValue("point %d\n" % i)
        flag.InsertNextValue(i % 3 == 1)
    here.AddArray(label)
    here.AddArray(flag)
    if not is_xml:
        fill_rest(data)


def fill_rest(data):
    data.GetFieldData().AddArray(array(np.array([0.5]), "TIME"))
    note = vtk.vtkStringArray()
    note.SetName("note")
    note.InsertNextValue("hello world")
    note.InsertNextValue("")
    data.GetFieldData().AddArray(note)
    data.GetCellData().AddArray(array(np.arange(data.GetNumberOfCells()) + 0.25, "cell value"))


def poly_data(is_xml):
    data = vtk.vtkPolyData()
    cells = vtk.vtkCellArray()
    for i in range(N):
        cells.InsertNextCell(1)
        cells.InsertCellPoint(i)
    data.SetVerts(cells)
    fill(data, is_xml)
    return data


def grid(is_xml):
    data = vtk.vtkUnstructuredGrid()
    data.Allocate(N)
    for i in range(N):
        data.InsertNextCell(vtk.VTK_VERTEX, 1, [i])
    fill(data, is_xml)
    return data


def legacy(data, writer, version, binary, name):
    out = writer()
    out.SetInputData(data)
    out.SetFileVersion(version)
    out.SetFileType(vtk.VTK_BINARY if binary else vtk.VTK_ASCII)
    out.SetFileName(name)
    out.Write()


def xml(data, writer, mode, compressor, wide, big, name):
    out = writer()
    out.SetInputData(data)
    out.SetEncodeAppendedData(mode == "base64")
    {
        "ascii": out.SetDataModeToAscii,
        "binary": out.SetDataModeToBinary,
        "raw": out.SetDataModeToAppended,
        "base64": out.SetDataModeToAppended,
    }[mode]()
    {
        "none": out.SetCompressorTypeToNone,
        "zlib": out.SetCompressorTypeToZLib,
        "lz4": out.SetCompressorTypeToLZ4,
        "lzma": out.SetCompressorTypeToLZMA,
    }[compressor]()
    # Several blocks of each array: the smallest that VTK takes, and a multiple of 8.
    out.SetBlockSize(32)
    (out.SetHeaderTypeToUInt64 if wide else out.SetHeaderTypeToUInt32)()
    (out.SetByteOrderToBigEndian if big else out.SetByteOrderToLittleEndian)()
    out.SetFileName(name)
    out.Write()
    # The room that VTK leaves for numbers is most of these files.
    with open(name, "rb") as file:
        tags, mark, appended = file.read().partition(b"<AppendedData")
    with open(name, "wb") as file:
        file.write(re.sub(rb" {2,}", b" ", tags) + mark + appended)


def main(everything):
    poly, cells = poly_data(False), grid(False)
    for version in (42, 51):
        for binary in (False, True):
            end = "%d_%s.vtk" % (version, "binary" if binary else "ascii")
            legacy(poly, vtk.vtkPolyDataWriter, version, binary, "poly_" + end)
            legacy(cells, vtk.vtkUnstructuredGridWriter, version, binary, "grid_" + end)
    poly, cells = poly_data(True), grid(True)
    some = {
        ("ascii", "none", False, False),
        ("binary", "zlib", True, False),
        ("binary", "none", False, True),
        ("raw", "none", True, False),
        ("raw", "lz4", False, False),
        ("base64", "zlib", False, True),
        ("base64", "none", True, False),
    }
    for mode in ("ascii", "binary", "raw", "base64"):
        for compressor in ("none", "zlib", "lz4") if mode != "ascii" else ("none",):
            for wide in (False, True):
                for big in (False, True):
                    if everything or (mode, compressor, wide, big) in some:
                        name = "%s_%s_%d%s" % (mode, compressor, 64 if wide else 32, "big" if big else "")
                        xml(cells, vtk.vtkXMLUnstructuredGridWriter, mode, compressor, wide, big, name + ".vtu")
                        if everything:
                            xml(poly, vtk.vtkXMLPolyDataWriter, mode, compressor, wide, big, name + ".vtp")
    xml(poly, vtk.vtkXMLPolyDataWriter, "raw", "zlib", False, False, "raw_zlib_32.vtp")


main("all" in sys.argv)
