// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/hdf_driver.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <limits>
#include <memory>
#include <sys/stat.h>
#include <unistd.h>

namespace talus::io::hdf {
namespace {

struct DriverInfo {
    WriteRecord* record;
};

/// HDF5 sees `base`, which must come first.
struct RecordedFile {
    H5FD_t base{};
    int descriptor = -1;
    haddr_t allocated = 0, end = 0;
    WriteRecord* record = nullptr;

    bool failed() const { return !record->error.empty(); }
    void note(int error) {
        if (!failed())
            record->error = std::strerror(error);
    }
};

RecordedFile& self(H5FD_t* file) {
    return *reinterpret_cast<RecordedFile*>(file);
}
const RecordedFile& self(const H5FD_t* file) {
    return *reinterpret_cast<const RecordedFile*>(file);
}

H5FD_t* open_file(const char* name, unsigned flags, hid_t access, haddr_t) {
    const auto* info = static_cast<const DriverInfo*>(H5Pget_driver_info(access));
    if (!info)
        return nullptr;
    int mode = O_RDWR | O_CLOEXEC;
    if (flags & H5F_ACC_CREAT)
        mode |= O_CREAT;
    if (flags & H5F_ACC_TRUNC)
        mode |= O_TRUNC;
    auto file = std::make_unique<RecordedFile>();
    file->record = info->record;
    file->descriptor = ::open(name, mode, 0666);
    struct stat status {};
    if (file->descriptor < 0 || ::fstat(file->descriptor, &status) != 0) {
        file->note(errno);
        if (file->descriptor >= 0)
            ::close(file->descriptor);
        return nullptr;
    }
    file->end = static_cast<haddr_t>(status.st_size);
    return &file.release()->base;
}

herr_t close_file(H5FD_t* base) {
    const std::unique_ptr<RecordedFile> file(&self(base));
    if (::close(file->descriptor) != 0)
        file->note(errno);
    return 0;
}

herr_t query(const H5FD_t*, unsigned long* flags) {
    if (flags)
        *flags = H5FD_FEAT_AGGREGATE_METADATA | H5FD_FEAT_ACCUMULATE_METADATA | H5FD_FEAT_DATA_SIEVE |
                 H5FD_FEAT_AGGREGATE_SMALLDATA;
    return 0;
}

haddr_t get_allocated(const H5FD_t* file, H5FD_mem_t) {
    return self(file).allocated;
}
herr_t set_allocated(H5FD_t* file, H5FD_mem_t, haddr_t address) {
    self(file).allocated = address;
    return 0;
}
haddr_t get_end(const H5FD_t* file, H5FD_mem_t) {
    return self(file).end;
}

herr_t read(H5FD_t* base, H5FD_mem_t, hid_t, haddr_t address, size_t size, void* buffer) {
    RecordedFile& file = self(base);
    auto* to = static_cast<char*>(buffer);
    auto from = static_cast<off_t>(address);
    while (size > 0) {
        const ssize_t got = ::pread(file.descriptor, to, std::min(size, size_t{1} << 30), from);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return -1;
        if (got == 0) { // beyond the end, as HDF5's own driver does
            std::memset(to, 0, size);
            return 0;
        }
        to += got;
        from += got;
        size -= static_cast<size_t>(got);
    }
    return 0;
}

herr_t write(H5FD_t* base, H5FD_mem_t, hid_t, haddr_t address, size_t size, const void* buffer) {
    RecordedFile& file = self(base);
    file.end = std::max(file.end, address + size);
    const auto* from = static_cast<const char*>(buffer);
    auto to = static_cast<off_t>(address);
    while (size > 0 && !file.failed()) {
        const ssize_t put = ::pwrite(file.descriptor, from, std::min(size, size_t{1} << 30), to);
        if (put < 0 && errno == EINTR)
            continue;
        if (put <= 0) {
            file.note(put < 0 ? errno : ENOSPC);
            break;
        }
        from += put;
        to += put;
        size -= static_cast<size_t>(put);
    }
    return 0;
}

herr_t truncate(H5FD_t* base, hid_t, hbool_t) {
    RecordedFile& file = self(base);
    if (file.allocated != file.end) {
        if (!file.failed() && ::ftruncate(file.descriptor, static_cast<off_t>(file.allocated)) != 0)
            file.note(errno);
        file.end = file.allocated;
    }
    return 0;
}

H5FD_class_t driver_class() {
    H5FD_class_t driver{};
    driver.name = "talus_recording";
    driver.maxaddr = static_cast<haddr_t>(std::numeric_limits<off_t>::max());
    driver.fc_degree = H5F_CLOSE_WEAK;
    driver.fapl_size = sizeof(DriverInfo);
    driver.open = open_file;
    driver.close = close_file;
    driver.query = query;
    driver.get_eoa = get_allocated;
    driver.set_eoa = set_allocated;
    driver.get_eof = get_end;
    driver.read = read;
    driver.write = write;
    driver.truncate = truncate;
    const H5FD_mem_t map[H5FD_MEM_NTYPES] = H5FD_FLMAP_DICHOTOMY;
    std::copy(std::begin(map), std::end(map), std::begin(driver.fl_map));
    return driver;
}

} // namespace

void use_recording_driver(hid_t access, WriteRecord& record) {
    static const H5FD_class_t driver = driver_class();
    static const hid_t id = H5FDregister(&driver);
    const DriverInfo info{&record};
    H5Pset_driver(access, id, &info);
}

} // namespace talus::io::hdf
