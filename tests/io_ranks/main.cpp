// SPDX-License-Identifier: GPL-3.0-or-later
/// Files that several processes write together: mpirun -n 3 io_ranks, in a folder of its own; or, in a folder
/// that has no room, mpirun -n 3 io_ranks full-disk FOLDER.
#include "../io/same_files.hpp"
#include "base/error.hpp"
#include "base/random.hpp"
#include "io/atomic_file.hpp"
#include "io/checkpoint_file.hpp"
#include "io/trajectory_file.hpp"

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <mpi.h>
#include <unistd.h>

namespace talus::io::test {
namespace {

namespace fs = std::filesystem;

bool good = true;

void check(bool right, const std::string& what) {
    if (right)
        return;
    int rank = 0;
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    std::fprintf(stderr, "rank %d: wrong: %s\n", rank, what.c_str());
    good = false;
}

/// The ranks of a communicator as writers of one file.
Together together_of(const MPI_Comm& communicator) {
    Together all;
    MPI_Comm_rank(communicator, &all.rank);
    MPI_Comm_size(communicator, &all.size);
    all.communicator = &communicator;
    all.broadcast = [communicator](void* data, std::size_t size) {
        MPI_Bcast(data, static_cast<int>(size), MPI_BYTE, 0, communicator);
    };
    all.agree = [communicator, rank = all.rank](const std::string& words) {
        const int mine = words.empty() ? 1 << 30 : rank;
        int lowest = 0, size = static_cast<int>(words.size());
        MPI_Allreduce(&mine, &lowest, 1, MPI_INT, MPI_MIN, communicator);
        if (lowest == 1 << 30)
            return std::string();
        std::string told = words;
        MPI_Bcast(&size, 1, MPI_INT, lowest, communicator);
        told.resize(static_cast<std::size_t>(size));
        MPI_Bcast(told.data(), size, MPI_CHAR, lowest, communicator);
        return told;
    };
    return all;
}

enum class Blocks { uneven, first_empty, all_with_the_last };

/// A rank's rows of n.
Rows rows_of(const Together& all, std::uint64_t n, Blocks blocks, std::uint64_t& count) {
    const auto start = [&](int rank) -> std::uint64_t {
        if (rank <= 0)
            return 0;
        if (rank >= all.size)
            return n;
        const auto r = static_cast<std::uint64_t>(rank), p = static_cast<std::uint64_t>(all.size);
        switch (blocks) {
        case Blocks::uneven: // and one in the middle empty
            return rank == 2 ? n / (p + 1) : n * r / (p + 1);
        case Blocks::first_empty:
            return rank == 1 ? 0 : n * (r - 1) / (p - 1);
        case Blocks::all_with_the_last:
            return 0;
        }
        return 0;
    };
    const std::uint64_t first = start(all.rank);
    count = start(all.rank + 1) - first;
    return {first, n};
}

template <class T>
std::vector<T> numbers(std::uint64_t first, std::uint64_t count) {
    std::vector<T> values(count);
    for (std::uint64_t i = 0; i < count; ++i)
        values[i] = static_cast<T>((first + i) * 2654435761u % 1000003u);
    return values;
}

CheckpointFile checkpoint(const Together& all, std::uint64_t n, Blocks blocks) {
    CheckpointFile file;
    const auto add = [&]<class T>(const char* name, std::uint64_t rows, std::size_t width, T) {
        std::uint64_t count = 0;
        const Rows mine = rows_of(all, rows, blocks, count);
        file.columns.push_back(
            {name, numbers<T>(mine.first * width, count * width), width, "m", all.alone() ? Rows{} : mine});
    };
    add("particles/position", n, 3, double{});
    add("particles/image", n, 3, std::int32_t{});
    add("contacts/pair", 3 * n + 1, 2, std::uint64_t{});
    add("contacts/state", 3 * n + 1, 1, std::uint8_t{});
    add("few", 3, 1, std::int8_t{});
    add("none", 0, 2, float{});
    file.columns.push_back({"whole", numbers<std::int64_t>(0, 5), 1, "", {}});
    file.attributes = {{"step", std::int64_t{7}}, {"time", 0.5}, {"name", std::string("slide")}};
    file.config = std::string(70'000, 'c');
    file.provenance = {{"dem-run", "1", "dem-run", "{}", 3, {"a.h5"}}};
    return file;
}

TrajectoryStatic statics(Rows rows, std::uint64_t count) {
    TrajectoryStatic s;
    for (std::uint64_t i = rows.first; i < rows.first + count; ++i) {
        s.radius.push_back(1 + static_cast<double>(i % 97));
        s.mass.push_back(2 + static_cast<double>(i % 89));
        s.species.push_back(static_cast<Species>(i % 3));
        s.material.push_back(static_cast<std::uint8_t>(i % 5));
    }
    s.box = {{0, 0, 0}, {1, 2, 3}, {true, false, false}};
    s.origin = {1, 2, 3};
    return s;
}

/// What a run would write between two points of it.
void write(TrajectoryWriter& writer, const Together& all, Rows rows, std::uint64_t count, int from, int to) {
    for (int k = from; k < to; ++k) {
        if (k % 4 == 0)
            writer.stage({"stage", k, 0.5 * k});
        for (int row = 0; row < 200; ++row)
            writer.series(
                {{"step", 200 * k + row}, {"time", 0.01 * row + k}, {"walls/floor/force_z", k * row}});
        std::vector<BondBreakage> broken;
        for (int b = 0; all.first() && b < 150 * (k % 3); ++b)
            broken.push_back({k, 0.5 * k, b, b + 1, {1.0 * b, 2, 3}, 1});
        writer.bond_breakages(broken);
        if (k % 3 != 0)
            continue;
        std::vector<Vec3> position, velocity;
        for (std::uint64_t i = rows.first; i < rows.first + count; ++i) {
            const auto x = static_cast<double>(i);
            position.push_back({x, x + k, 0.25 * k});
            velocity.push_back({-x, 1.0 * k, 0.5});
        }
        writer.frame(k, 0.5 * k, {{"position", position}, {"velocity", velocity}});
    }
}

constexpr int whole_run = 16;
const Provenance before = {{"tile-trim", "1", "tile-trim", "{}", 0, {}}};

void write_trajectory(const std::string& path, const Together& all, std::uint64_t n, Blocks blocks) {
    std::uint64_t count = 0;
    const Rows rows = rows_of(all, n, blocks, count);
    TrajectoryWriter writer(path, statics(rows, count), before, "{}", true, all, rows);
    write(writer, all, rows, count, 0, whole_run);
    writer.finish();
}

/// Writes up to `point`, takes the image into a checkpoint, writes on, and leaves the file.
void interrupt(const std::string& path, const Together& all, std::uint64_t n, Blocks blocks, int point) {
    std::uint64_t count = 0;
    const Rows rows = rows_of(all, n, blocks, count);
    TrajectoryWriter writer(path, statics(rows, count), before, "{}", true, all, rows);
    write(writer, all, rows, count, 0, point);
    CheckpointFile saved;
    put(saved, writer.image());
    write_checkpoint(path + ".ckpt", saved, all);
    write(writer, all, rows, count, point, point + 5);
    writer.suspend();
}

void go_on(const std::string& path, const Together& all, std::uint64_t n, Blocks blocks, int point) {
    std::uint64_t count = 0;
    const Rows rows = rows_of(all, n, blocks, count);
    const auto image = trajectory_image(CheckpointReader(path + ".ckpt"));
    TrajectoryWriter writer =
        TrajectoryWriter::resume(path, image.value(), statics(rows, count), before, "{}", true, all, rows);
    write(writer, all, rows, count, point, whole_run);
    writer.finish();
}

/// Overwrites what a run killed in the middle of writing may have left wrong.
void tear(const std::string& path) {
    const TrajectoryImage image = trajectory_image(CheckpointReader(path + ".ckpt")).value();
    std::fstream file(partial_path(path), std::ios::in | std::ios::out | std::ios::binary);
    const std::string rubbish(64, 'r');
    for (const Extent& range : image.ranges)
        for (std::uint64_t at = range.offset + 4; at + 64 < range.offset + range.size; at += 997) {
            file.seekp(static_cast<std::streamoff>(at));
            file.write(rubbish.data(), 64);
        }
    file.seekp(static_cast<std::streamoff>(image.length));
    file.write(rubbish.data(), 64);
    check(file.good(), "tearing " + path);
}

/// Expects an Error of this code, with the same words on all ranks.
void check_error(const Together& all, ExitCode code, const std::string& words,
                 const std::function<void()>& action) {
    std::string told;
    try {
        action();
    } catch (const Error& error) {
        told = error.what();
        check(error.code() == code, "exit code of: " + told);
    }
    check(told.find(words) != std::string::npos, "\"" + words + "\" in \"" + told + "\"");
    check(told == from_first(all, told), "the same words on all ranks");
}

void run_checks(const fs::path& folder, const Together& world) {
    const auto in = [&](const char* name) { return (folder / name).string(); };
    const Together alone;
    const auto by_first = [&](const std::function<void()>& action) {
        if (world.first())
            action();
        MPI_Barrier(MPI_COMM_WORLD);
    };
    for (const Blocks blocks : {Blocks::uneven, Blocks::first_empty, Blocks::all_with_the_last}) {
        const std::string what = " with blocks " + std::to_string(static_cast<int>(blocks));
        for (const std::uint64_t n :
             {1u, 5u, 200'000u}) { // 3 n doubles: part of a chunk of 4 MiB, and several
            by_first([&] { write_checkpoint(in("alone.ckpt"), checkpoint(alone, n, blocks)); });
            write_checkpoint(in("all.ckpt"), checkpoint(world, n, blocks), world);
            by_first([&] {
                check(checkpoint_difference(in("alone.ckpt"), in("all.ckpt")).empty(),
                      checkpoint_difference(in("alone.ckpt"), in("all.ckpt")) + what);
            });
            const CheckpointReader reader(in("all.ckpt")); // parts, each rank its own
            std::uint64_t count = 0;
            const Rows rows = rows_of(world, 3 * n + 1, Blocks::uneven, count);
            const Column part = reader.read("contacts/pair", rows.first, count);
            check(std::get<std::vector<std::uint64_t>>(part.data) ==
                      numbers<std::uint64_t>(2 * rows.first, 2 * count),
                  "a part of a checkpoint");
        }
        for (const std::uint64_t n : {3u, 300'000u}) { // within one chunk of a frame, and in two
            by_first([&] { write_trajectory(in("alone.traj.h5"), alone, n, blocks); });
            write_trajectory(in("all.traj.h5"), world, n, blocks);
            by_first([&] {
                check(trajectory_difference(in("alone.traj.h5"), in("all.traj.h5")).empty(),
                      trajectory_difference(in("alone.traj.h5"), in("all.traj.h5")) + what);
            });
        }
    }

    // On another number of ranks: all of them, the first alone, all but the last.
    const std::uint64_t n = 3000;
    MPI_Comm fewer = MPI_COMM_NULL;
    const bool in_fewer = world.rank < std::max(1, world.size - 1);
    MPI_Comm_split(MPI_COMM_WORLD, in_fewer ? 0 : 1, world.rank, &fewer);
    const Together some = together_of(fewer);
    by_first([&] { write_trajectory(in("whole.traj.h5"), alone, n, Blocks::uneven); });
    const std::string path = in("a.traj.h5");
    const auto by = [&](int who, const std::function<void(const Together&)>& action) {
        if (who == 0)
            action(world);
        else if (who == 1 ? world.first() : in_fewer)
            action(who == 1 ? alone : some);
        MPI_Barrier(MPI_COMM_WORLD);
    };
    for (int before_it = 0; before_it < 3; ++before_it)
        for (int after = 0; after < 3; ++after)
            for (const int point : {0, 6, 11}) {
                by(before_it, [&](const Together& all) { interrupt(path, all, n, Blocks::uneven, point); });
                by_first([&] { tear(path); });
                by(after, [&](const Together& all) { go_on(path, all, n, Blocks::first_empty, point); });
                by_first([&] {
                    const std::string difference = trajectory_difference(in("whole.traj.h5"), path);
                    check(difference.empty(), difference + " after resuming at " + std::to_string(point) +
                                                  ", " + std::to_string(before_it) + " to " +
                                                  std::to_string(after));
                });
            }
    MPI_Comm_free(&fewer);

    // Errors that one rank finds are everybody's.
    std::uint64_t count = 0;
    const Rows rows = rows_of(world, n, Blocks::uneven, count);
    check_error(world, ExitCode::output_exists, path,
                [&] { TrajectoryWriter(path, statics(rows, count), {}, "", false, world, rows); });
    check_error(world, ExitCode::run_failed, "row 2999 ", [&] {
        TrajectoryWriter writer(in("b.traj.h5"), statics(rows, count), {}, "", true, world, rows);
        std::vector<Vec3> position(count);
        if (world.rank == world.size - 1)
            position.back().y = std::nan("");
        writer.frame(0, 0, {{"position", position}});
    });
    check(!fs::exists(partial_path(in("b.traj.h5"))), "nothing left");
    check_error(world, ExitCode::input_invalid, "c.traj.h5.part", [&] {
        TrajectoryWriter::resume(in("c.traj.h5"), {}, statics(rows, count), {}, "", true, world, rows);
    });
}

/// In a folder with little room: a checkpoint that fits, one that does not, then a trajectory.
void full_disk(const fs::path& folder, const Together& world) {
    const std::string saved = (folder / "a.ckpt").string(), path = (folder / "a.traj.h5").string();
    CheckpointFile small;
    small.attributes = {{"time", 1.0}};
    write_checkpoint(saved, small, world);
    check_error(world, ExitCode::run_failed, saved + ": cannot be written: No space left on device",
                [&] { write_checkpoint(saved, checkpoint(world, 100'000, Blocks::uneven), world); });
    if (world.first()) {
        check(read_checkpoint(saved).attributes == small.attributes, "the previous checkpoint");
        check(!fs::exists(partial_path(saved)), "no part of a checkpoint left");
    }
    check_error(world, ExitCode::run_failed, path + ": cannot be written: No space left on device", [&] {
        std::uint64_t count = 0;
        const Rows rows = rows_of(world, 1000, Blocks::uneven, count);
        TrajectoryWriter writer(path, statics(rows, count), {}, "", true, world, rows);
        write(writer, world, rows, count, 0, 1000);
    });
    if (world.first())
        check(!fs::exists(partial_path(path)), "no part of a trajectory left");
}

} // namespace
} // namespace talus::io::test

int main(int argc, char** argv) {
    using namespace talus::io;
    MPI_Init(&argc, &argv);
    const MPI_Comm communicator = MPI_COMM_WORLD;
    const Together world = test::together_of(communicator);
    const bool full = argc == 3 && std::string(argv[1]) == "full-disk";
    namespace fs = std::filesystem;
    const fs::path folder = from_first(
        world, full
                   ? argv[2]
                   : (fs::temp_directory_path() / ("talus_io_ranks_" + std::to_string(::getpid()))).string());
    try {
        if (full) {
            test::full_disk(folder, world);
        } else {
            fs::create_directories(folder);
            test::run_checks(folder, world);
        }
    } catch (const std::exception& error) {
        test::check(false, error.what());
        MPI_Abort(MPI_COMM_WORLD, 1);
    }
    int bad = test::good ? 0 : 1, any = 0;
    MPI_Allreduce(&bad, &any, 1, MPI_INT, MPI_MAX, MPI_COMM_WORLD);
    if (!full && world.first())
        fs::remove_all(folder);
    MPI_Barrier(MPI_COMM_WORLD);
    if (full) { // no regular end: the HDF5 library may wait for ever
        if (world.first() && any == 0)
            std::puts("full disk: all as it should be");
        std::fflush(stdout);
        MPI_Barrier(MPI_COMM_WORLD);
        ::_exit(any);
    }
    MPI_Finalize();
    return any;
}
