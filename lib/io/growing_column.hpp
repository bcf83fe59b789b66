// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/extent.hpp"
#include "io/hdf_file.hpp"
#include "io/trajectory_layout.hpp"

#include <string>
#include <string_view>
#include <vector>

namespace talus::io {

/// A growing column without compression: its chunks keep their size and are rewritten in place, so that what
/// was flushed stays whole while the next rows arrive.
struct Growing {
    static constexpr hsize_t block = layout::rows_at_once;

    hdf::Dataset dataset;
    hsize_t rows = 0;
    hsize_t lasting = 0; ///< chunks that are full and known to last

    template <class T>
    static Growing create(const hdf::Group& group, const std::string& name, std::string_view unit,
                          hsize_t width = 1) {
        const hdf::Dims dims = width > 1 ? hdf::Dims{0, width} : hdf::Dims{0};
        const hdf::Dims chunk = width > 1 ? hdf::Dims{block, width} : hdf::Dims{block};
        return {group.create(name, hdf::file_type<T>(), dims,
                             {.unit = unit, .chunk = chunk, .extendable = true})};
    }
    /// As a resumed file has it; its full chunks are known.
    static Growing open(const hdf::Group& group, const std::string& name) {
        Growing column{group.dataset(name)};
        const hdf::Dims dims = column.dataset.dims();
        column.rows = dims.empty() ? 0 : dims[0];
        column.lasting = column.rows / block;
        return column;
    }
    template <class T>
    void append(const T* values, hsize_t count) {
        dataset.append(values, count);
        rows += count;
    }
    /// Adds the chunks that have become full to `extents`; after a flush.
    void find_full(std::vector<Extent>& extents) {
        hdf::Dims count = dataset.dims(), offset(count.size(), 0);
        offset[0] = lasting * block;
        count[0] = rows / block * block - offset[0];
        dataset.find_chunks(offset, count, extents);
        lasting = rows / block;
    }
};

} // namespace talus::io
