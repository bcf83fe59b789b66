// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/hdf_file.hpp"

#include <algorithm>

namespace talus::io::hdf {

// H5T_NATIVE_... are macros that open the library, so they cannot be constants.
#define TALUS_HDF_TYPE(T, memory, file)                                                                      \
    template <>                                                                                              \
    hid_t memory_type<T>() {                                                                                 \
        return memory;                                                                                       \
    }                                                                                                        \
    template <>                                                                                              \
    hid_t file_type<T>() {                                                                                   \
        return file;                                                                                         \
    }
TALUS_HDF_TYPE(double, H5T_NATIVE_DOUBLE, H5T_IEEE_F64LE)
TALUS_HDF_TYPE(float, H5T_NATIVE_FLOAT, H5T_IEEE_F32LE)
TALUS_HDF_TYPE(std::int64_t, H5T_NATIVE_INT64, H5T_STD_I64LE)
TALUS_HDF_TYPE(std::uint64_t, H5T_NATIVE_UINT64, H5T_STD_U64LE)
TALUS_HDF_TYPE(std::int32_t, H5T_NATIVE_INT32, H5T_STD_I32LE)
TALUS_HDF_TYPE(std::uint32_t, H5T_NATIVE_UINT32, H5T_STD_U32LE)
TALUS_HDF_TYPE(std::int8_t, H5T_NATIVE_INT8, H5T_STD_I8LE)
TALUS_HDF_TYPE(std::uint8_t, H5T_NATIVE_UINT8, H5T_STD_U8LE)
#undef TALUS_HDF_TYPE

namespace {

/// Whole rows, as many as make up 4 MiB: a reader that wants a part need not undo the filters of everything.
Dims default_chunk(const Dims& dims, std::size_t value_size) {
    hsize_t row = value_size;
    for (std::size_t k = 1; k < dims.size(); ++k)
        row *= std::max<hsize_t>(dims[k], 1);
    Dims chunk(dims);
    chunk[0] = std::max<hsize_t>(1, (hsize_t{4} << 20) / row);
    return chunk;
}

Id space_of(hid_t dataset) {
    return {H5Dget_space(dataset), H5Sclose};
}

Dims chunk_of(hid_t dataset) {
    const Id creation(H5Dget_create_plist(dataset), H5Pclose);
    if (H5Pget_layout(creation) != H5D_CHUNKED)
        return {};
    Dims chunk(H5S_MAX_RANK);
    chunk.resize(static_cast<std::size_t>(std::max(0, H5Pget_chunk(creation, H5S_MAX_RANK, chunk.data()))));
    return chunk;
}

/// Where each filter stands in the dataset's pipeline; -1: it is not there.
int filter_position(hid_t creation, H5Z_filter_t wanted) {
    const int count = H5Pget_nfilters(creation);
    for (int k = 0; k < count; ++k) {
        unsigned flags = 0;
        std::size_t values = 0;
        if (H5Pget_filter2(creation, static_cast<unsigned>(k), &flags, &values, nullptr, 0, nullptr,
                           nullptr) == wanted)
            return k;
    }
    return -1;
}

/// The index of the chunks has no checksum of its own (a version 1 B-tree): where damage makes it lose a
/// chunk, HDF5 gives zeros; where damage sets a chunk's filter mask, HDF5 skips the checksum. So each chunk
/// that is to be read must be there and have passed through its checksum; one that was not compressed must
/// have the size of its data.
bool chunks_are_sound(hid_t dataset, const Dims& first, const Dims& count) {
    const Id creation(H5Dget_create_plist(dataset), H5Pclose);
    const Id type(H5Dget_type(dataset), H5Tclose);
    const Dims chunk = chunk_of(dataset);
    const int checksum = filter_position(creation, H5Z_FILTER_FLETCHER32);
    const int deflate = filter_position(creation, H5Z_FILTER_DEFLATE);
    const int filters = H5Pget_nfilters(creation);
    hsize_t bytes = H5Tget_size(type);
    for (const hsize_t c : chunk)
        bytes *= c;
    const std::size_t rank = first.size();
    Dims offset(rank);
    for (std::size_t k = 0; k < rank; ++k) {
        if (count[k] == 0)
            return true;
        offset[k] = first[k] / chunk[k] * chunk[k];
    }
    const Dims start = offset;
    for (;;) {
        unsigned mask = 0;
        haddr_t address = HADDR_UNDEF;
        hsize_t size = 0;
        hsize_t found = 0; // by the same search that H5Dread uses; the next call goes through all chunks
        if (H5Dget_chunk_storage_size(dataset, offset.data(), &found) < 0 || found == 0 ||
            H5Dget_chunk_info_by_coord(dataset, offset.data(), &mask, &address, &size) < 0 ||
            address == HADDR_UNDEF)
            return false;
        if (checksum >= 0 && (mask >> checksum & 1u) != 0)
            return false;
        const bool plain =
            filters == (checksum >= 0 ? 1 : 0) || (deflate >= 0 && (mask >> deflate & 1u) != 0);
        if (plain && size != bytes + (checksum >= 0 ? 4 : 0))
            return false;
        std::size_t k = rank;
        for (;;) { // next chunk, last dimension fastest
            if (k-- == 0)
                return true;
            offset[k] += chunk[k];
            if (offset[k] < first[k] + count[k])
                break;
            offset[k] = start[k];
        }
    }
}

} // namespace

Dataset::Dataset(const Context* context, std::string path, Id id)
    : context_(context), path_(std::move(path)), id_(std::move(id)) {}

Dims Dataset::dims() const {
    const Id space = space_of(id_);
    const int rank = H5Sget_simple_extent_ndims(space);
    if (rank < 0)
        context_->fail_hdf(path_, "read");
    Dims dims(static_cast<std::size_t>(rank));
    H5Sget_simple_extent_dims(space, dims.data(), nullptr);
    return dims;
}

std::size_t Dataset::size() const {
    std::size_t n = 1;
    for (const hsize_t d : dims())
        n *= d;
    return n;
}

bool Dataset::is_number() const {
    const Id type(H5Dget_type(id_), H5Tclose);
    const H5T_class_t kind = H5Tget_class(type);
    return kind == H5T_INTEGER || kind == H5T_FLOAT || kind == H5T_ENUM;
}

bool Dataset::stored_as(hid_t wanted) const {
    const Id type(H5Dget_type(id_), H5Tclose);
    return H5Tequal(type, wanted) > 0;
}

void Dataset::read_slab(hid_t type, void* out, const Dims& offset, const Dims& count) const {
    if (!is_number())
        context_->fail(path_, "holds no numbers; write it as numbers");
    const Id space = space_of(id_);
    Id memory_space;
    if (!offset.empty()) {
        H5Sselect_hyperslab(space, H5S_SELECT_SET, offset.data(), nullptr, count.data(), nullptr);
        memory_space = Id(H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr), H5Sclose);
    }
    const Dims whole = dims();
    if (!chunk_of(id_).empty() && !chunks_are_sound(id_, offset.empty() ? Dims(whole.size(), 0) : offset,
                                                    offset.empty() ? whole : count))
        context_->fail(path_,
                       "a part of the data was never written or its index is damaged; copy the file again or "
                       "make it anew");
    // A chunk that needs conversion passes in strips through a small buffer; without a cache that holds the
    // chunk, HDF5 would undo the filters of the whole chunk for each strip.
    Id again;
    const Id stored(H5Dget_type(id_), H5Tclose);
    std::size_t chunk_bytes = H5Tget_size(stored);
    for (const hsize_t c : chunk_of(id_))
        chunk_bytes *= c;
    if (chunk_bytes > (std::size_t{1} << 20) && H5Tequal(stored, type) <= 0) {
        const Id access(H5Pcreate(H5P_DATASET_ACCESS), H5Pclose);
        H5Pset_chunk_cache(access, 521, chunk_bytes + 1, 1.0);
        again = Id(H5Dopen2(id_, path_.c_str(), access), H5Dclose);
    }
    if (H5Dread(again.valid() ? hid_t(again) : hid_t(id_), type,
                memory_space.valid() ? hid_t(memory_space) : H5S_ALL, space, H5P_DEFAULT, out) < 0)
        context_->fail_hdf(path_, "read");
}

void Dataset::write_slab(hid_t type, const void* values, const Dims& offset, const Dims& count) const {
    const Id space = space_of(id_);
    Id memory_space;
    if (!offset.empty()) {
        H5Sselect_hyperslab(space, H5S_SELECT_SET, offset.data(), nullptr, count.data(), nullptr);
        memory_space = Id(H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr), H5Sclose);
    }
    if (H5Sget_select_npoints(space) > 0 &&
        H5Dwrite(id_, type, memory_space.valid() ? hid_t(memory_space) : H5S_ALL, space, H5P_DEFAULT,
                 values) < 0)
        context_->fail_hdf(path_, "written");
    context_->check_writes();
}

void Dataset::append_rows(hid_t type, const void* values, hsize_t rows) const {
    if (rows == 0)
        return;
    Dims count = dims();
    Dims offset(count.size(), 0);
    offset[0] = count[0];
    count[0] += rows;
    if (H5Dset_extent(id_, count.data()) < 0)
        context_->fail_hdf(path_, "extended");
    count[0] = rows;
    write_slab(type, values, offset, count);
}

void Dataset::check() const {
    if (!is_number()) {
        const Id type(H5Dget_type(id_), H5Tclose);
        if (H5Tget_class(type) != H5T_STRING || H5Tis_variable_str(type) > 0)
            return;
        std::vector<char> data(size() * H5Tget_size(type));
        if (H5Dread(id_, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data.data()) < 0)
            context_->fail_hdf(path_, "read");
        return;
    }
    const Id type(H5Dget_type(id_), H5Tclose);
    const std::size_t value_size = H5Tget_size(type);
    const Dims all = dims();
    Dims chunk = chunk_of(id_);
    if (all.empty()) { // a scalar
        std::vector<char> value(value_size);
        if (H5Dread(id_, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, value.data()) < 0)
            context_->fail_hdf(path_, "read");
        return;
    }
    if (std::find(all.begin(), all.end(), hsize_t{0}) != all.end())
        return;
    if (chunk.empty())
        chunk = default_chunk(all, value_size);
    std::size_t bytes = value_size;
    for (const hsize_t c : chunk)
        bytes *= c;
    std::vector<char> data(bytes);
    Dims offset(all.size(), 0);
    do {
        Dims count(all.size());
        for (std::size_t k = 0; k < all.size(); ++k)
            count[k] = std::min(chunk[k], all[k] - offset[k]);
        read_slab(type, data.data(), offset, count);
        std::size_t k = all.size();
        while (k-- > 0) { // next chunk, last dimension fastest
            offset[k] += chunk[k];
            if (offset[k] < all[k] || k == 0)
                break;
            offset[k] = 0;
        }
    } while (offset[0] < all[0]);
}

Dataset Group::create(const std::string& name, hid_t stored_type, const Dims& dims,
                      const Layout& layout) const {
    const Id creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    H5Pset_obj_track_times(creation, false);
    Dims chunk = layout.chunk.empty() ? default_chunk(dims, H5Tget_size(stored_type)) : layout.chunk;
    for (std::size_t k = 0; k < dims.size(); ++k) {
        if (!layout.extendable && layout.chunk.empty())
            chunk[k] = std::min(chunk[k], dims[k]);
        chunk[k] = std::max<hsize_t>(chunk[k], 1);
    }
    H5Pset_chunk(creation, static_cast<int>(chunk.size()), chunk.data());
    // What a chunk holds beyond the data's end is zero, not whatever memory held.
    const double zero = 0;
    if (H5Tget_class(stored_type) != H5T_STRING)
        H5Pset_fill_value(creation, H5T_NATIVE_DOUBLE, &zero);
    if (layout.filter == Filter::compressed) {
        H5Pset_shuffle(creation);
        H5Pset_deflate(creation, 1);
    }
    H5Pset_fletcher32(creation); // last, so over what is on the disk
    Dims most = dims;
    if (layout.extendable)
        most[0] = H5S_UNLIMITED;
    const Id space(H5Screate_simple(static_cast<int>(dims.size()), dims.data(), most.data()), H5Sclose);
    const auto slash = name.find_last_of('/');
    if (slash != std::string::npos && slash > 0)
        create_group(name.substr(0, slash)); // so that times are not tracked
    Dataset dataset(
        context_, path(name),
        Id(H5Dcreate2(id_, name.c_str(), stored_type, space, H5P_DEFAULT, creation, H5P_DEFAULT), H5Dclose));
    if (dataset.id() < 0)
        context_->fail_hdf(path(name), "created");
    if (!layout.unit.empty())
        dataset.set("unit", std::string(layout.unit));
    return dataset;
}

} // namespace talus::io::hdf
