// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <hdf5.h>
#include <string>

namespace talus::io::hdf {

/// What went wrong while a file was written; empty: nothing.
struct WriteRecord {
    std::string error; ///< the operating system's words, of the first failure only
};

/// Makes `access` (a file access property list) write through a file driver of our own. It is HDF5's POSIX
/// driver but for one thing: a write that fails (full disk, file size limit) goes into `record`, and HDF5 is
/// told that all is well. HDF5 1.10 cannot close a file whose last writes failed: H5Fclose fails, the
/// identifiers stay open and the library crashes at exit. The caller looks into `record` after each call and
/// throws then. `record` must outlive the file.
void use_recording_driver(hid_t access, WriteRecord& record);

} // namespace talus::io::hdf
