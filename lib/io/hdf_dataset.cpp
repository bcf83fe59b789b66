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

constexpr std::uint64_t header = 8192;     ///< bytes of a new dataset's header and index, at most
constexpr std::uint64_t index_entry = 128; ///< of a chunk's checksum and its place in the index, at most

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

/// Bytes of the chunks that a slab touches, with what the file needs about them, at most.
std::uint64_t stored_bytes(std::size_t value_size, const Dims& chunk, const Dims& first, const Dims& count) {
    std::uint64_t bytes = value_size, chunks = 1;
    for (std::size_t k = 0; k < chunk.size(); ++k) {
        bytes *= chunk[k];
        chunks *= count[k] == 0 ? 0 : (first[k] + count[k] - 1) / chunk[k] - first[k] / chunk[k] + 1;
    }
    return chunks * (bytes + index_entry);
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

/// Calls `visit(offset)` for each chunk that the slab touches, last dimension fastest, while it returns true.
template <class Visit>
bool each_chunk(const Dims& chunk, const Dims& first, const Dims& count, Visit visit) {
    const std::size_t rank = first.size();
    Dims offset(rank);
    for (std::size_t k = 0; k < rank; ++k) {
        if (count[k] == 0)
            return true;
        offset[k] = first[k] / chunk[k] * chunk[k];
    }
    const Dims start = offset;
    for (;;) {
        if (!visit(offset))
            return false;
        std::size_t k = rank;
        for (;;) { // next chunk
            if (k-- == 0)
                return true;
            offset[k] += chunk[k];
            if (offset[k] < first[k] + count[k])
                break;
            offset[k] = start[k];
        }
    }
}

/// The index of the chunks has no checksum of its own (a version 1 B-tree): where damage makes it lose a
/// chunk, HDF5 gives zeros; where damage sets a chunk's filter mask, HDF5 skips the checksum. So each chunk
/// that is to be read must be there and have passed through its checksum; one that was not compressed must
/// have the size of its data. What is not seen: an address that was changed to a place full of zeros, of
/// which the checksum is zero as well, in a chunk that was not compressed.
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
    return each_chunk(chunk, first, count, [&](const Dims& offset) {
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
        return !plain || size == bytes + (checksum >= 0 ? 4 : 0);
    });
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

std::uint64_t Dataset::stored_size() const {
    return H5Dget_storage_size(id_);
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

void Dataset::write_whole(hid_t type, const void* values) const {
    const Dims whole = dims();
    const Dims start(whole.size(), 0);
    write_slab(type, values, {start, context_->writers.together.first() ? whole : start}, {start, whole});
}

void Dataset::write_slab(hid_t type, const void* values, const Slab& mine, const Slab& all) const {
    const Id space = space_of(id_);
    const auto empty = [](const Dims& count) {
        return std::find(count.begin(), count.end(), hsize_t{0}) != count.end();
    };
    if (empty(all.count))
        return;
    const Id memory_space(H5Screate_simple(static_cast<int>(mine.count.size()), mine.count.data(), nullptr),
                          H5Sclose);
    if (empty(mine.count))
        H5Sselect_none(space);
    else
        H5Sselect_hyperslab(space, H5S_SELECT_SET, mine.offset.data(), nullptr, mine.count.data(), nullptr);
    const Id transfer(H5Pcreate(H5P_DATASET_XFER), H5Pclose);
    if (!context_->alone())
        H5Pset_dxpl_mpio(transfer, H5FD_MPIO_COLLECTIVE);
    context_->settle(H5Dwrite(id_, type, memory_space, space, transfer, values) >= 0, path_, "written");
}

void Dataset::append_rows(hid_t type, const void* values, hsize_t rows, const hsize_t* part) const {
    if (rows == 0)
        return;
    Dims whole = dims();
    Slab all{Dims(whole.size(), 0), whole};
    all.offset[0] = whole[0];
    all.count[0] = rows;
    whole[0] += rows;
    if (!context_->alone()) {
        const Id stored(H5Dget_type(id_), H5Tclose);
        const Dims chunk = chunk_of(id_);
        Slab fresh = all; // rows that fit into the last chunk take no more room
        fresh.offset[0] = (all.offset[0] + chunk[0] - 1) / chunk[0] * chunk[0];
        fresh.count[0] = whole[0] > fresh.offset[0] ? whole[0] - fresh.offset[0] : 0;
        context_->make_room(stored_bytes(H5Tget_size(stored), chunk, fresh.offset, fresh.count));
    }
    context_->settle(H5Dset_extent(id_, whole.data()) >= 0, path_, "extended");
    if (!context_->alone())
        allocate(all);
    Slab mine = all;
    if (part) {
        mine.offset[1] = part[0];
        mine.count[1] = part[1];
    } else if (!context_->writers.together.first()) {
        mine.count[0] = 0;
    }
    write_slab(type, values, mine, all);
}

void Dataset::append_chunk(std::span<const std::byte> stored, unsigned filter_mask) const {
    Dims whole = dims();
    Dims offset(whole.size(), 0);
    offset[0] = whole[0];
    whole[0] += chunk_of(id_)[0];
    context_->settle(H5Dset_extent(id_, whole.data()) >= 0, path_, "extended");
    context_->settle(
        H5Dwrite_chunk(id_, H5P_DEFAULT, filter_mask, offset.data(), stored.size(), stored.data()) >= 0,
        path_, "written");
}

void Dataset::allocate(const Slab& slab) const {
    const Dims chunk = chunk_of(id_);
    const Id stored(H5Dget_type(id_), H5Tclose);
    std::size_t bytes = H5Tget_size(stored);
    for (const hsize_t c : chunk)
        bytes *= c;
    std::vector<char> zeros; // their checksum is zero, too
    each_chunk(chunk, slab.offset, slab.count, [&](const Dims& offset) {
        hsize_t found = 0;
        if (H5Dget_chunk_storage_size(id_, offset.data(), &found) >= 0 && found > 0)
            return true; // it fails where there is no chunk at all
        zeros.resize(bytes + 4);
        context_->settle(H5Dwrite_chunk(id_, H5P_DEFAULT, 0, offset.data(), zeros.size(), zeros.data()) >= 0,
                         path_, "extended");
        return true;
    });
}

void Dataset::find_chunks(const Dims& offset, const Dims& count, std::vector<Extent>& extents) const {
    each_chunk(chunk_of(id_), offset, count, [&](const Dims& chunk) {
        unsigned mask = 0;
        haddr_t address = HADDR_UNDEF;
        hsize_t size = 0;
        if (H5Dget_chunk_info_by_coord(id_, chunk.data(), &mask, &address, &size) < 0 ||
            address == HADDR_UNDEF)
            context_->fail_hdf(path_, "found");
        extents.push_back({address, size});
        return true;
    });
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
    // Several ranks: HDF5 makes and fills all chunks at once.
    context_->make_room(header + stored_bytes(H5Tget_size(stored_type), chunk, Dims(dims.size(), 0), dims));
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
    context_->settle(dataset.id() >= 0, path(name), "created");
    if (!layout.unit.empty())
        dataset.set("unit", std::string(layout.unit));
    return dataset;
}

} // namespace talus::io::hdf
