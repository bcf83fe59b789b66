// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "io/attributes.hpp"
#include "io/provenance.hpp"
#include "io/together.hpp"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <variant>
#include <vector>

namespace talus::io {

/// One named array of a checkpoint: data[row * width + k]. The name may contain '/' ("contacts/pair").
struct Column {
    using Data =
        std::variant<std::vector<double>, std::vector<float>, std::vector<std::int64_t>,
                     std::vector<std::uint64_t>, std::vector<std::int32_t>, std::vector<std::uint32_t>,
                     std::vector<std::int8_t>, std::vector<std::uint8_t>>;
    std::string name;
    Data data;
    std::size_t width = 1;
    std::string unit; ///< "m s-1"; empty: no dimension
    Rows rows = {};   ///< what of the column is here; total 0: all of it (on every rank alike)

    friend bool operator==(const Column&, const Column&) = default;
};

/// The engine's state as named columns (`*.ckpt.h5`), so that it can grow without a new format. The file
/// keeps the order of the columns and every bit of their values (NaN included).
struct CheckpointFile {
    std::vector<Column> columns;
    /// Written behind `columns`: groups of columns that are made, one group after the other, when their turn
    /// has come, so that not all are in memory together. Collective like write_checkpoint.
    std::vector<std::function<std::vector<Column>()>> later;
    Attributes attributes; ///< counters, time, step ...
    std::string config;    ///< effective configuration, JSON
    Provenance provenance;

    const Column* find(const std::string& name) const;
    /// The column's data as vectors of T. @throws Error input_invalid where it is absent or of another type.
    template <class T>
    const std::vector<T>& get(const std::string& name) const {
        const Column* column = find(name);
        const auto* data = column ? std::get_if<std::vector<T>>(&column->data) : nullptr;
        if (!data)
            refuse(name, column != nullptr);
        return *data;
    }

private:
    [[noreturn]] static void refuse(const std::string& name, bool present);
};

/// Replaces the checkpoint at `path`: temporary name, sync, the old one kept as previous_checkpoint(path),
/// rename, sync of the folder. At every instant `path` is a whole checkpoint where there was one before.
/// Collective over `together`: each rank gives its rows of the columns (Column::rows), everything else alike;
/// the file does not tell how many ranks wrote it.
/// @throws Error run_failed, on all ranks; the old checkpoint then stays. Several ranks must then end at
/// once, by _exit: the HDF5 library may not be able to close the file.
void write_checkpoint(const std::string& path, const CheckpointFile& file, const Together& together = {});

/// Reads a checkpoint column by column, whole or a part of the rows: each process by itself.
/// Everything throws Error input_invalid naming file, place and cure.
class CheckpointReader {
public:
    explicit CheckpointReader(const std::string& path);
    ~CheckpointReader();
    CheckpointReader(CheckpointReader&&) noexcept;
    CheckpointReader& operator=(CheckpointReader&&) noexcept;

    Attributes attributes() const;
    std::string config() const;
    Provenance provenance() const;
    const std::vector<std::string>& names() const; ///< of the columns, in the order they were given
    bool has(const std::string& name) const;
    std::uint64_t rows(const std::string& name) const;
    std::size_t width(const std::string& name) const;
    Column read(const std::string& name) const;
    /// Rows [first, first + count); Column::rows tells which of how many.
    Column read(const std::string& name, std::uint64_t first, std::uint64_t count) const;

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// All of it. @throws Error input_invalid naming file, place and cure.
CheckpointFile read_checkpoint(const std::string& path);

/// `path` with ".prev" behind.
std::string previous_checkpoint(const std::string& path);

/// Where to resume from: `path`, else the previous one, whichever is complete and passes its checksums; empty
/// where neither does.
std::string usable_checkpoint(const std::string& path);

} // namespace talus::io
