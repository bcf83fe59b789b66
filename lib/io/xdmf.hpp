// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace talus::io {

/// Numbers of an HDF5 file as XDMF names them. `frames` > 0: the dataset is [frames][rows][width], else
/// [rows][width] ([rows] where width is 1).
struct XdmfArray {
    std::string name, path;
    std::size_t rows = 0, width = 1;
    const char* number = "Float"; ///< Float, Int, UInt, UChar
    int precision = 8;            ///< bytes
    std::size_t frames = 0;
};

/// Points with attributes for ParaView's XDMF readers, as references into `hdf5_file` (a path; its last part
/// is written, since the sidecar lies in the same folder). The first array gives the points. With `times` (s)
/// it is a series of as many grids; of frames with the same time, the last.
std::string xdmf_points(const std::string& hdf5_file, const std::string& name,
                        const std::vector<XdmfArray>& arrays, const std::vector<double>& times = {});

/// A surface of triangles or quadrilaterals, with values on its cells.
struct XdmfSurface {
    std::string name;
    XdmfArray points, corners; ///< corners: [cells][3 or 4], numbers of points
    std::vector<XdmfArray> cells;
};
std::string xdmf_surfaces(const std::string& hdf5_file, const std::vector<XdmfSurface>& surfaces);

} // namespace talus::io
