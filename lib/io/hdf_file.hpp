// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/error.hpp"
#include "io/attributes.hpp"
#include "io/extent.hpp"
#include "io/hdf_driver.hpp"
#include "io/together.hpp"

#include <cstddef>
#include <cstdint>
#include <hdf5.h>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace talus::io {
class AtomicFile;
}

/// HDF5's C API with owned identifiers and errors that name file and place. Only io/ includes this.
namespace talus::io::hdf {

/// Who writes a file, and where room for it comes from.
///
/// Several ranks write through HDF5's MPI-IO driver. It cannot stand a failed write: ranks part ways inside
/// collective calls, and the file cannot be closed. So room on the disk is taken before each write, failures
/// are told to all ranks right after it, and from then on identifiers stay open (Id::leave_open).
struct Writers {
    Together together;
    AtomicFile* output = nullptr; ///< the first rank's, which takes the room; not needed alone
    bool in_memory = false;       ///< no file is made: to learn how large it would be
};

/// Which file the objects below belong to; its words make the errors.
struct Context {
    std::string name; ///< as the user gave it
    bool writing = false;
    WriteRecord record;
    Writers writers;

    bool alone() const { return writers.together.alone(); }
    /// Collective: throws on all ranks where an HDF5 call failed (`good` is false) on any.
    void settle(bool good, const std::string& place, const std::string& doing) const;
    /// Notes that about so many bytes more will be written at the next flush.
    void expect(std::uint64_t bytes) const { unflushed += bytes; }
    /// Collective: makes sure of room for `bytes` more, and all that was expected; nothing alone.
    void make_room(std::uint64_t bytes) const;
    /// Everything has been flushed.
    void note_flush() const;

    /// "file: place: what", with input_invalid while reading and run_failed while writing.
    [[noreturn]] void fail(const std::string& place, const std::string& what) const;
    /// The same for an HDF5 call that failed: the library's innermost words, or why writing stopped.
    [[noreturn]] void fail_hdf(const std::string& place, const std::string& doing) const;
    /// Throws where a write has failed behind HDF5's back.
    void check_writes() const;

private:
    mutable std::uint64_t flushed = 0;   ///< length of the file at the last flush (first rank)
    mutable std::uint64_t unflushed = 0; ///< bytes given to HDF5 since
};

/// An identifier with its closing function.
class Id {
public:
    using Close = herr_t (*)(hid_t);
    Id() = default;
    Id(hid_t id, Close close) : id_(id), close_(close) {}
    ~Id() { reset(); }
    Id(Id&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
    Id& operator=(Id&& other) noexcept {
        if (this != &other) {
            reset();
            id_ = std::exchange(other.id_, -1);
            close_ = other.close_;
        }
        return *this;
    }
    operator hid_t() const { return id_; }
    bool valid() const { return id_ >= 0; }
    void reset() {
        if (id_ >= 0 && !open_forever)
            close_(std::exchange(id_, -1));
    }
    hid_t release() { return std::exchange(id_, -1); }
    /// No identifier is closed any more: after a failed write of several ranks closing may wait for ever. The
    /// process is to end by _exit.
    static void leave_open() { open_forever = true; }

private:
    static inline bool open_forever = false;
    hid_t id_ = -1;
    Close close_ = nullptr;
};

/// HDF5's types of T in memory and in our files (little endian everywhere).
template <class T>
hid_t memory_type();
template <class T>
hid_t file_type();

using Dims = std::vector<hsize_t>;

enum class Filter { checksum, compressed }; ///< fletcher32; shuffle + deflate + fletcher32

struct Layout {
    std::string_view unit = "";
    Filter filter = Filter::checksum;
    Dims chunk = {};         ///< empty: whole rows up to 4 MiB
    bool extendable = false; ///< along the first dimension
    Rows rows = {};          ///< what of the column is here; total 0: all of it, on every rank
};

class Dataset {
public:
    Dataset() = default;
    Dataset(const Context* context, std::string path, Id id);

    const std::string& path() const { return path_; }
    const Context& context() const { return *context_; }
    hid_t id() const { return id_; }
    Dims dims() const;
    template <class T>
    bool stored_as() const {
        return stored_as(file_type<T>());
    }
    bool is_number() const;

    /// Everything, converted to T; `out` holds as many values as the dataset.
    template <class T>
    void read(T* out) const {
        read_slab(memory_type<T>(), out, {}, {});
    }
    template <class T>
    std::vector<T> read() const {
        std::vector<T> values(size());
        read(values.data());
        return values;
    }
    template <class T>
    void read(T* out, const Dims& offset, const Dims& count) const {
        read_slab(memory_type<T>(), out, offset, count);
    }
    // Writing is collective: what is whole is given alike on all ranks, and rank 0's is written.
    template <class T>
    void write(const T* values) const {
        write_whole(memory_type<T>(), values);
    }
    /// As write(), of text.
    void write_text(hid_t type, const char* text) const { write_whole(type, text); }
    /// Each rank its own slab.
    template <class T>
    void write_part(const T* values, const Dims& offset, const Dims& count) const {
        write_slab(memory_type<T>(), values, {offset, count}, {Dims(offset.size(), 0), dims()});
    }
    /// Extends the first dimension by `rows` and writes them.
    template <class T>
    void append(const T* values, hsize_t rows) const {
        append_rows(memory_type<T>(), values, rows, nullptr);
    }
    /// Extends the first dimension by one row, of which each rank writes `count` from `first` on along the
    /// second.
    template <class T>
    void append_part(const T* values, hsize_t first, hsize_t count) const {
        const hsize_t part[] = {first, count};
        append_rows(memory_type<T>(), values, 1, part);
    }
    /// Extends by one chunk, of an extendable dataset of one process, as it is to lie in the file
    /// (ChunkPress).
    /// @param filter_mask bit of each filter that was left out
    void append_chunk(std::span<const std::byte> stored, unsigned filter_mask) const;
    /// Adds to `extents` where the file holds the chunks of this slab (flushed).
    void find_chunks(const Dims& offset, const Dims& count, std::vector<Extent>& extents) const;
    /// Reads chunk by chunk and drops the data: tests the checksums.
    void check() const;
    std::size_t size() const;
    std::uint64_t stored_size() const; ///< bytes of the data in the file, after filters
    void set(const std::string& name, std::span<const double> values) const;
    void set(const std::string& name, const std::string& text) const;

private:
    bool stored_as(hid_t type) const;
    void read_slab(hid_t type, void* out, const Dims& offset, const Dims& count) const;
    struct Slab {
        Dims offset, count;
    };
    void write_whole(hid_t type, const void* values) const;
    /// Writes `mine`; that of all ranks together lies in `all`.
    void write_slab(hid_t type, const void* values, const Slab& mine, const Slab& all) const;
    /// Makes the chunks of the slab where there are none: several ranks can write (HDF5 1.10) only what is
    /// there. Where they make a dataset HDF5 sees to that, but the dataset may have been made by one process
    /// alone.
    void allocate(const Slab& slab) const;
    /// @param part first and count along the second dimension; null: all, rank 0's
    void append_rows(hid_t type, const void* values, hsize_t rows, const hsize_t* part) const;

    const Context* context_ = nullptr;
    std::string path_;
    Id id_;
};

class Group {
public:
    Group() = default;
    Group(const Context* context, std::string path, Id id);

    const std::string& path() const { return path_; }
    std::string path(std::string_view name) const;
    const Context& context() const { return *context_; }
    hid_t id() const { return id_; }

    bool has(const std::string& name) const;      ///< object `name` (may contain '/') exists
    bool is_group(const std::string& name) const; ///< ... and is a group
    std::vector<std::string> names() const;       ///< of direct members, sorted
    Group group(const std::string& name) const;
    Dataset dataset(const std::string& name) const;

    /// Missing groups on the way are made.
    Group create_group(const std::string& name) const;
    Dataset create(const std::string& name, hid_t stored_type, const Dims& dims, const Layout& layout) const;
    template <class T>
    Dataset write(const std::string& name, const T* values, const Dims& dims,
                  const Layout& layout = {}) const {
        if (layout.rows.total == 0) {
            Dataset dataset = create(name, file_type<T>(), dims, layout);
            dataset.write(values);
            return dataset;
        }
        Dims whole = dims, offset(dims.size(), 0);
        whole[0] = layout.rows.total;
        offset[0] = layout.rows.first;
        Dataset dataset = create(name, file_type<T>(), whole, layout);
        dataset.write_part(values, offset, dims);
        return dataset;
    }
    template <class T>
    Dataset write(const std::string& name, const std::vector<T>& values, const Layout& layout = {}) const {
        return write(name, values.data(), {values.size()}, layout);
    }
    /// Text of any length as a scalar dataset inside the object header (which has a checksum of its own), or
    /// as one chunk where it is too long for that.
    void write_text(const std::string& name, const std::string& text) const;
    void write_texts(const std::string& name, const std::vector<std::string>& texts) const;
    std::string read_text(const std::string& name) const;
    std::vector<std::string> read_texts(const std::string& name) const;
    void link(const std::string& name, const Group& from, const std::string& target) const; ///< hard link
    void unlink(const std::string& name) const;

    void set(const std::string& name, double value) const;
    void set(const std::string& name, std::int64_t value) const;
    void set(const std::string& name, const std::string& text) const;
    void set(const std::string& name, const char* text) const { set(name, std::string(text)); }
    void set(const std::string& name, std::span<const double> values) const;
    void set(const std::string& name, std::span<const std::int64_t> values) const;
    void set(const std::string& name, const std::vector<std::string>& texts) const;

    /// Attributes; where there is none, a dataset of that name serves too (files of other programs).
    std::optional<double> number(const std::string& name) const;
    std::optional<std::int64_t> integer(const std::string& name) const;
    std::optional<std::string> text(const std::string& name) const;
    std::vector<double> numbers(const std::string& name) const;    ///< empty: absent
    std::vector<std::string> texts(const std::string& name) const; ///< empty: absent
    Attributes attributes() const; ///< all scalars; integers and truth values as int64
    void set(const Attributes& attributes) const;

private:
    const Context* context_ = nullptr;
    std::string path_;
    Id id_;
};

/// Attributes of any object, as Group::numbers and Group::text; `holder` is a path below `group`.
std::vector<double> attribute_numbers(const Group& group, const std::string& holder, const std::string& name);
std::optional<std::string> attribute_text(const Group& group, const std::string& holder,
                                          const std::string& name);

class File {
public:
    /// Creates `path` (truncating it) for the output that errors call `name`. Collective.
    static File create(const std::string& path, const std::string& name, const Writers& writers = {});
    /// Opens `path` to read and to write; errors are those of reading until now_written(). Collective.
    static File modify(const std::string& path, const Writers& writers);
    /// @throws Error input_invalid: missing, not HDF5, truncated.
    static File open(const std::string& path);

    /// A file that several ranks write and that was not closed stays open: closing is collective.
    ~File();
    File() = default;
    File(File&&) noexcept = default;
    File& operator=(File&&) noexcept = default;

    Group root() const;
    const Context& context() const { return *context_; }
    /// From now on errors are those of writing the output that the user calls `name`.
    void now_written(const std::string& name);
    void flush() const;
    std::uint64_t length() const; ///< bytes, flushed
    void close();                 ///< and throws where something could not be written

private:
    static File begin(const std::string& name, bool writing);

    std::unique_ptr<Context> context_;
    Id id_;
};

} // namespace talus::io::hdf
