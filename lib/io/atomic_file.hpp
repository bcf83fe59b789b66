// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>
#include <string_view>

namespace talus::io {

/// The name under which `path` is written until it is whole: `path` with ".part" behind, in the same folder.
std::string partial_path(const std::string& path);

/// The XDMF file next to an HDF5 file: the name's ".h5" becomes ".xdmf".
std::string sidecar_path(const std::string& path);

/// A file that is complete or absent: write to partial(), then commit(). The destructor removes what was not
/// committed.
class AtomicFile {
public:
    /// @throws Error output_exists where `path` exists and `overwrite` is false; run_failed where the folder
    /// is absent or not writable, or `path` is no regular file.
    AtomicFile(const std::string& path, bool overwrite);
    /// Goes on with the partial file that an interrupted run left, as it is.
    /// @throws Error input_invalid where there is none; else as above.
    static AtomicFile take_over(const std::string& path, bool overwrite);
    ~AtomicFile();
    AtomicFile(AtomicFile&& other) noexcept;
    AtomicFile& operator=(AtomicFile&&) = delete;

    const std::string& path() const { return path_; }       ///< as the user gave it
    const std::string& partial() const { return partial_; } ///< to be written

    int descriptor() const { return lock_; } ///< of the partial file, to read and to write

    std::uint64_t length() const; ///< of the partial file, bytes

    /// Appends to the partial file (for text; HDF5 opens it by name).
    void write(std::string_view content);
    /// Takes room on the disk for the partial file up to `end` bytes, without making it longer; does nothing
    /// where the file system cannot. @throws Error run_failed where there is not so much.
    void reserve(std::uint64_t end);
    /// Brings the partial file's bytes to the disk. @throws Error run_failed
    void sync() const;
    /// Syncs the partial file, optionally keeps the present one under `keep_previous`, renames, syncs the
    /// folder.
    void commit(const std::string& keep_previous = "");
    /// Removes the partial file.
    void abandon() noexcept;
    /// Leaves the partial file where it is, for somebody to go on with.
    void leave() noexcept;

private:
    enum class Partial { anew, as_it_is };
    AtomicFile(const std::string& path, bool overwrite, Partial partial);
    bool rename_to_new() const;

    std::string path_, target_, partial_;
    bool overwrite_ = false;
    int lock_ = -1; ///< descriptor of the partial file, locked against a second writer
};

/// Writes `content` as a whole file, complete or absent. @throws Error as AtomicFile.
void write_text_file(const std::string& path, std::string_view content, bool overwrite);

} // namespace talus::io
