// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "base/error.hpp"
#include "io/attributes.hpp"
#include "io/hdf_driver.hpp"

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

/// HDF5's C API with owned identifiers and errors that name file and place. Only io/ includes this.
namespace talus::io::hdf {

/// Which file the objects below belong to; its words make the errors.
struct Context {
    std::string name; ///< as the user gave it
    bool writing = false;
    WriteRecord record;

    /// "file: place: what", with input_invalid while reading and run_failed while writing.
    [[noreturn]] void fail(const std::string& place, const std::string& what) const;
    /// The same for an HDF5 call that failed: the library's innermost words, or why writing stopped.
    [[noreturn]] void fail_hdf(const std::string& place, const std::string& doing) const;
    /// Throws where a write has failed behind HDF5's back.
    void check_writes() const;
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
        if (id_ >= 0)
            close_(std::exchange(id_, -1));
    }

private:
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
    template <class T>
    void write(const T* values) const {
        write_slab(memory_type<T>(), values, {}, {});
    }
    /// Extends the first dimension by `rows` and writes them.
    template <class T>
    void append(const T* values, hsize_t rows) const {
        append_rows(memory_type<T>(), values, rows);
    }
    /// Reads chunk by chunk and drops the data: tests the checksums.
    void check() const;
    std::size_t size() const;
    void set(const std::string& name, std::span<const double> values) const;
    void set(const std::string& name, const std::string& text) const;

private:
    bool stored_as(hid_t type) const;
    void read_slab(hid_t type, void* out, const Dims& offset, const Dims& count) const;
    void write_slab(hid_t type, const void* values, const Dims& offset, const Dims& count) const;
    void append_rows(hid_t type, const void* values, hsize_t rows) const;

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
        Dataset dataset = create(name, file_type<T>(), dims, layout);
        dataset.write(values);
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
    /// Creates `path` (truncating it) for the output that errors call `name`.
    static File create(const std::string& path, const std::string& name);
    /// @throws Error input_invalid: missing, not HDF5, truncated.
    static File open(const std::string& path);

    Group root() const;
    const Context& context() const { return *context_; }
    void flush() const;
    void close(); ///< and throws where something could not be written

private:
    std::unique_ptr<Context> context_;
    Id id_;
};

} // namespace talus::io::hdf
