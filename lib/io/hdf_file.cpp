// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/hdf_file.hpp"

#include "io/atomic_file.hpp"

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>
#include <mutex>
#include <unistd.h>

namespace talus::io::hdf {
namespace {

/// HDF5 prints nothing; its words go into our errors.
void silence() {
    static std::once_flag once;
    std::call_once(once, [] { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); });
}

struct Words {
    std::string innermost;
    bool checksum = false, truncated = false;
};

herr_t collect(unsigned n, const H5E_error2_t* error, void* data) {
    auto& words = *static_cast<Words*>(data);
    const std::string text = error->desc ? error->desc : "";
    if (n == 0)
        words.innermost = text;
    words.checksum |=
        text.find("Fletcher32") != std::string::npos || text.find("checksum") != std::string::npos;
    words.truncated |= text.find("truncated file") != std::string::npos;
    return 0;
}

Words words_of_hdf() {
    Words words;
    H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, collect, &words);
    for (char& c : words.innermost)
        if (c == '\n')
            c = ' ';
    if (words.innermost.empty())
        words.innermost = "the HDF5 library gives no reason";
    return words;
}

std::string size_of(const std::string& path) {
    std::error_code ignored;
    const auto size = std::filesystem::file_size(path, ignored);
    return ignored ? "" : fmt::format(" after {} bytes", size);
}

constexpr std::uint64_t room_for_metadata = 64 * 1024; ///< bytes, beside what is expected

/// Bounds, no caching surprises: metadata leaves memory at a flush only, so that what a killed process leaves
/// is the state of its last flush.
Id access_for_writing(Context& context) {
    Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_V110);
    H5Pset_fclose_degree(access, H5F_CLOSE_STRONG);
    H5AC_cache_config_t cache{};
    cache.version = H5AC__CURR_CACHE_CONFIG_VERSION;
    H5Pget_mdc_config(access, &cache);
    cache.evictions_enabled = false;
    cache.incr_mode = H5C_incr__off;
    cache.flash_incr_mode = H5C_flash_incr__off;
    cache.decr_mode = H5C_decr__off;
    if (!context.alone()) {
        cache.dirty_bytes_threshold = 32 * 1024 * 1024; // the most that HDF5 takes
        cache.metadata_write_strategy = H5AC_METADATA_WRITE_STRATEGY__PROCESS_0_ONLY;
    }
    H5Pset_mdc_config(access, &cache);
    if (context.writers.in_memory) {
        // What its length tells is that of a closed file: no strides, nothing kept in reserve.
        H5Pset_fapl_core(access, 1, false);
        H5Pset_meta_block_size(access, 1);
        H5Pset_small_data_block_size(access, 1);
    } else if (context.alone())
        use_recording_driver(access, context.record);
    else
        H5Pset_fapl_mpio(access, *static_cast<const MPI_Comm*>(context.writers.together.communicator),
                         MPI_INFO_NULL);
    return access;
}

} // namespace

void Context::fail(const std::string& place, const std::string& what) const {
    throw Error(writing ? ExitCode::run_failed : ExitCode::input_invalid,
                place.empty() ? fmt::format("{}: {}", name, what)
                              : fmt::format("{}: {}: {}", name, place, what));
}

void Context::fail_hdf(const std::string& place, const std::string& doing) const {
    check_writes();
    const Words words = words_of_hdf();
    if (writing)
        fail(place, fmt::format("cannot be {}: {}", doing, words.innermost));
    if (words.checksum)
        fail(place, "checksum does not match, the data are damaged; copy the file again or make it anew");
    fail(place, fmt::format("cannot be {} ({}), the file is damaged; copy it again or make it anew", doing,
                            words.innermost));
}

void Context::check_writes() const {
    if (!record.error.empty())
        fail("", fmt::format("cannot be written: {}; make room or choose another place for the output",
                             record.error));
}

void Context::settle(bool good, const std::string& place, const std::string& doing) const {
    if (alone()) {
        if (!good)
            fail_hdf(place, doing);
        return check_writes();
    }
    try {
        all_or_none(writers.together, [&] {
            if (!good)
                fail_hdf(place, doing);
        });
    } catch (const Error&) {
        Id::leave_open();
        throw;
    }
}

void Context::make_room(std::uint64_t bytes) const {
    if (alone())
        return;
    expect(bytes);
    all_or_none(writers.together, [&] {
        if (writers.output)
            writers.output->reserve(flushed + unflushed + room_for_metadata);
    });
}

void Context::note_flush() const {
    unflushed = 0;
    if (writers.output)
        flushed = writers.output->length();
}

File::~File() {
    if (context_ && !context_->alone())
        (void)id_.release();
}

File File::begin(const std::string& name, bool writing) {
    silence();
    File file;
    file.context_ = std::make_unique<Context>();
    file.context_->name = name;
    file.context_->writing = writing;
    return file;
}

File File::create(const std::string& path, const std::string& name, const Writers& writers) {
    File file = begin(name, true);
    file.context_->writers = writers;
    const Id access = access_for_writing(*file.context_);
    const Id creation(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
    H5Pset_obj_track_times(creation, false);
    file.id_ = Id(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, creation, access), H5Fclose);
    file.context_->settle(file.id_.valid(), "", "created");
    return file;
}

File File::modify(const std::string& path, const Writers& writers) {
    File file = begin(path, false);
    file.context_->writers = writers;
    file.id_ = Id(H5Fopen(path.c_str(), H5F_ACC_RDWR, access_for_writing(*file.context_)), H5Fclose);
    file.context_->settle(file.id_.valid(), "", "opened");
    file.context_->note_flush();
    return file;
}

void File::now_written(const std::string& name) {
    context_->name = name;
    context_->writing = true;
}

File File::open(const std::string& path) {
    File file = begin(path, false);
    const Context& context = *file.context_;
    std::error_code error;
    const auto status = std::filesystem::status(path, error);
    if (status.type() == std::filesystem::file_type::not_found)
        context.fail("", "no such file; check the name");
    if (status.type() == std::filesystem::file_type::directory)
        context.fail("", "is a folder, a file is needed; name the file");
    if (::access(path.c_str(), R_OK) != 0)
        context.fail("", fmt::format("cannot be read: {}; check its permissions", std::strerror(errno)));
    if (std::filesystem::is_regular_file(status) && std::filesystem::file_size(path, error) == 0)
        context.fail("", "is empty; make it anew");
    if (H5Fis_hdf5(path.c_str()) <= 0)
        context.fail("", "is not an HDF5 file; give a file made by one of these tools");
    const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_V110);
    H5Pset_fclose_degree(access, H5F_CLOSE_STRONG);
    H5Pset_file_locking(access, false, true);
    file.id_ = Id(H5Fopen(path.c_str(), H5F_ACC_RDONLY, access), H5Fclose);
    if (!file.id_.valid()) {
        if (words_of_hdf().truncated)
            context.fail("", fmt::format("is truncated{}; copy it again or make it anew", size_of(path)));
        context.fail_hdf("", "opened");
    }
    return file;
}

Group File::root() const {
    Id id(H5Gopen2(id_, "/", H5P_DEFAULT), H5Gclose);
    if (!id.valid())
        context_->fail_hdf("/", "opened");
    return {context_.get(), "/", std::move(id)};
}

void File::flush() const {
    context_->make_room(0);
    context_->settle(H5Fflush(id_, H5F_SCOPE_LOCAL) >= 0, "", "flushed");
    context_->note_flush();
}

std::uint64_t File::length() const {
    hsize_t size = 0;
    context_->settle(H5Fget_filesize(id_, &size) >= 0, "", "measured");
    return size;
}

void File::close() {
    context_->make_room(0);
    context_->settle(H5Fclose(id_.release()) >= 0, "", "closed");
}

} // namespace talus::io::hdf
