// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "terrain/raster.hpp"

#include <cstddef>

namespace talus::tiling::testing {

/// A raster of z(x, y) over [x0, x0 + width * cell] x [y0, y0 + height * cell].
template <class Height>
terrain::Raster surface(double x0, double y0, std::size_t width, std::size_t height, double cell,
                        Height&& z) {
    terrain::Raster raster;
    raster.width = width;
    raster.height = height;
    raster.lower_x = x0;
    raster.lower_y = y0;
    raster.cell_x = raster.cell_y = cell;
    raster.name = "synthetic";
    for (std::size_t row = 0; row < height; ++row)
        for (std::size_t column = 0; column < width; ++column)
            raster.values.push_back(z(raster.centre_x(column), raster.centre_y(row)));
    raster.valid.assign(raster.size(), 1);
    return raster;
}

} // namespace talus::tiling::testing
