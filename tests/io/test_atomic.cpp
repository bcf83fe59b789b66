// SPDX-License-Identifier: GPL-3.0-or-later
#include "samples.hpp"

#include "io/atomic_file.hpp"
#include "io/quick_check.hpp"

#include <csignal>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/wait.h>

namespace talus::io::test {
namespace {

using Atomic = FileTest;

/// Runs `body` in a child process; true where it returned true.
bool in_child(const std::function<bool()>& body) {
    const pid_t child = ::fork();
    if (child == 0)
        ::_exit(body() ? 0 : 1);
    int status = 0;
    ::waitpid(child, &status, 0);
    return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

TEST_F(Atomic, existing_output_is_refused_and_kept) {
    put_bytes(path("a.h5"), "precious");
    const auto refused = [&](const std::function<void()>& write) {
        expect_error(ExitCode::output_exists, {path("a.h5"), "--overwrite"}, write);
        EXPECT_EQ(bytes_of(path("a.h5")), "precious");
        EXPECT_EQ(file_count(), 1u);
    };
    refused([&] { write_pgbox(path("a.h5"), sample_pgbox(), false); });
    refused([&] { write_model(path("a.h5"), {sample_grains(), {}, ""}, false); });
    refused([&] { TrajectoryWriter(path("a.h5"), sample_statics(), {}, "", false); });
    refused([&] { write_text_file(path("a.h5"), "text", false); });
    write_pgbox(path("a.h5"), sample_pgbox(), true);
    EXPECT_EQ(read_pgbox(path("a.h5")).box.size(), 50u);
}

TEST_F(Atomic, output_that_appears_while_writing_is_kept) {
    AtomicFile file(path("a.txt"), false);
    file.write("mine");
    put_bytes(path("a.txt"), "theirs");
    expect_error(ExitCode::output_exists, {path("a.txt")}, [&] { file.commit(); });
    EXPECT_EQ(bytes_of(path("a.txt")), "theirs");
}

TEST_F(Atomic, second_writer_is_refused) {
    const AtomicFile first(path("a.txt"), true);
    expect_error(ExitCode::run_failed, {path("a.txt"), "another program"},
                 [&] { AtomicFile(path("a.txt"), true); });
    EXPECT_TRUE(std::filesystem::exists(first.partial()));
}

TEST_F(Atomic, a_link_stays_and_its_target_is_replaced) {
    put_bytes(path("target.txt"), "old");
    std::filesystem::create_symlink("target.txt", path("link.txt"));
    write_text_file(path("link.txt"), "new", true);
    EXPECT_TRUE(std::filesystem::is_symlink(path("link.txt")));
    EXPECT_EQ(bytes_of(path("target.txt")), "new");
}

TEST_F(Atomic, places_that_cannot_be_written) {
    expect_error(ExitCode::run_failed, {"no_such_folder/a.h5", "No such file or directory", "folder"},
                 [&] { write_pgbox(path("no_such_folder/a.h5"), sample_pgbox(), false); });
    expect_error(ExitCode::run_failed, {"/dev/full", "no regular file"},
                 [&] { write_pgbox("/dev/full", sample_pgbox(), true); });
    expect_error(ExitCode::run_failed, {folder.string(), "no regular file"},
                 [&] { write_pgbox(folder.string(), sample_pgbox(), true); });
}

TEST_F(Atomic, invalid_data_are_not_written) {
    PgBoxFile file = sample_pgbox();
    file.box.radius[3] = -1;
    expect_error(ExitCode::run_failed, {"a.h5", "/particles/all/radius", "row 3"},
                 [&] { write_pgbox(path("a.h5"), file, false); });
    Grains grains = sample_grains();
    grains.position[5].y = std::nan("");
    expect_error(ExitCode::run_failed, {"a.h5", "/particles/all/position", "row 5"}, [&] {
        write_model(path("a.h5"), {grains, {}, ""}, false);
    });
    EXPECT_EQ(file_count(), 0u);
}

TEST_F(Atomic, trajectory_without_finish_leaves_nothing) {
    {
        TrajectoryWriter writer(path("a.traj.h5"), sample_statics(), {}, "", false);
        write_frames(writer, 30, 2);
        EXPECT_EQ(file_count(), 1u);
    }
    EXPECT_EQ(file_count(), 0u);
    TrajectoryWriter writer(path("a.traj.h5"), sample_statics(), {}, "", false);
    auto rows = sample_frame(30, 0);
    rows[4].x = std::nan("");
    expect_error(ExitCode::run_failed, {"a.traj.h5", "position", "row 4", "step 7"}, [&] {
        writer.frame(7, 0, {{"position", rows}});
    });
    EXPECT_EQ(file_count(), 0u);
    expect_error(ExitCode::run_failed, {"a.traj.h5", "earlier failure"}, [&] { writer.finish(); });
}

TEST_F(Atomic, wrong_use_of_a_trajectory) {
    const auto rows = sample_frame(30, 0);
    const auto refused = [&](const std::vector<std::string>& words,
                             const std::function<void(TrajectoryWriter&)>& use) {
        TrajectoryWriter writer(path("a.traj.h5"), sample_statics(), {}, "", false);
        expect_error(ExitCode::run_failed, words, [&] { use(writer); });
    };
    refused({"without positions"}, [&](auto& w) { w.frame(0, 0, {{"velocity", rows}}); });
    refused({"3 rows"}, [&](auto& w) { w.frame(0, 0, {{"position", std::span(rows).first(3)}}); });
    refused({"same fields"}, [&](auto& w) {
        w.frame(0, 0, {{"position", rows}, {"force", rows}});
        w.frame(1, 1, {{"position", rows}, {"velocity", rows}});
    });
    refused({"without step or time"}, [&](auto& w) { w.series({{"step", 0}, {"energy", 1}}); });
    refused({"same columns"}, [&](auto& w) {
        w.series({{"step", 0}, {"time", 0}, {"a", 1}});
        w.series({{"step", 0}, {"time", 0}, {"b", 1}});
    });
}

TEST_F(Atomic, killed_writer_leaves_its_frames) {
    const std::string name = path("a.traj.h5");
    const pid_t child = ::fork();
    if (child == 0) {
        TrajectoryWriter writer(name, sample_statics(20'000), sample_provenance(), "{}", false);
        write_frames(writer, 20'000, 2);
        for (int i = 0; i < 1500; ++i) // rows and breakages behind the last flush must do no harm
            writer.series({{"step", 20 + i}, {"time", 0.2 + i}, {"walls/floor/force_z", 1}});
        const std::vector<BondBreakage> broken(5000);
        writer.bond_breakages(broken);
        ::kill(::getpid(), SIGKILL);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status));
    EXPECT_FALSE(std::filesystem::exists(name));
    EXPECT_FALSE(inspect(partial_path(name)).complete);
    expect_error(ExitCode::input_invalid, {partial_path(name), "complete is not 1", "resumes"},
                 [&] { TrajectoryReader reader(partial_path(name)); });
    const TrajectoryReader reader(partial_path(name), TrajectoryReader::Accept::incomplete);
    EXPECT_FALSE(reader.complete());
    ASSERT_EQ(reader.frames(), 2u);
    for (int f = 0; f < 2; ++f) {
        EXPECT_EQ(reader.read(static_cast<std::size_t>(f), "position"), sample_frame(20'000, f));
        EXPECT_EQ(reader.read(static_cast<std::size_t>(f), "velocity"), sample_frame(20'000, -f));
    }
    EXPECT_GE(reader.series("time").size(), 2u);
    EXPECT_EQ(reader.series("time")[1], 0.1);
    EXPECT_GE(reader.bond_breakages().size(), 2u);
    // and the next run takes the place of what was left
    TrajectoryWriter writer(name, sample_statics(), {}, "", false);
    writer.finish();
    EXPECT_TRUE(std::filesystem::exists(name));
    EXPECT_FALSE(std::filesystem::exists(partial_path(name)));
}

TEST_F(Atomic, checkpoint_keeps_the_previous_one) {
    const std::string name = path("a.ckpt.h5");
    EXPECT_EQ(usable_checkpoint(name), "");
    write_checkpoint(name, sample_checkpoint(1));
    EXPECT_FALSE(std::filesystem::exists(previous_checkpoint(name)));
    write_checkpoint(name, sample_checkpoint(2));
    write_checkpoint(name, sample_checkpoint(3));
    EXPECT_EQ(std::get<double>(read_checkpoint(name).attributes.at("time")), 3);
    EXPECT_EQ(std::get<double>(read_checkpoint(previous_checkpoint(name)).attributes.at("time")), 2);
    EXPECT_EQ(file_count(), 2u);
    EXPECT_EQ(usable_checkpoint(name), name);
    const std::string whole = bytes_of(name);
    put_bytes(name, whole.substr(0, whole.size() / 2));
    EXPECT_EQ(usable_checkpoint(name), previous_checkpoint(name));
    put_bytes(previous_checkpoint(name), "");
    EXPECT_EQ(usable_checkpoint(name), "");
}

/// Every way of writing in a place without room: an Error, and nothing left.
bool fails_cleanly(const std::filesystem::path& place, const std::string& reason) {
    std::error_code ignored;
    const auto fails = [&](const std::function<void(const std::string&)>& write) {
        const std::string name = (place / "a.h5").string();
        try {
            write(name);
            std::fprintf(stderr, "no error\n");
            return false;
        } catch (const Error& error) {
            const std::string line = error.what();
            if (error.code() != ExitCode::run_failed || line.find(reason) == std::string::npos ||
                line.find(name) == std::string::npos) {
                std::fprintf(stderr, "%s\n", line.c_str());
                return false;
            }
        }
        return std::filesystem::is_empty(place, ignored);
    };
    const std::size_t n = 20'000;
    bool good = fails([&](const std::string& name) { write_pgbox(name, sample_pgbox(n), false); });
    good &= fails([&](const std::string& name) { write_model(name, {sample_grains(n), {}, ""}, false); });
    good &= fails([&](const std::string& name) {
        CheckpointFile file;
        file.columns = {{"a", std::vector<double>(100'000), 1, ""},
                        {"b", std::vector<double>(100'000, 1.5), 1, ""}};
        write_checkpoint(name, file);
    });
    good &= fails([&](const std::string& name) {
        TrajectoryWriter writer(name, sample_statics(1000), {}, "", false);
        write_frames(writer, 1000, 100);
        writer.finish();
    });
    good &= fails([&](const std::string& name) { write_text_file(name, std::string(1 << 20, 'x'), false); });
    return good;
}

TEST_F(Atomic, full_disk_leaves_nothing) {
    if (::mount("tmpfs", folder.c_str(), "tmpfs", 0, "size=300k") != 0)
        GTEST_SKIP() << "a tmpfs cannot be mounted here";
    const bool good = in_child([&] { return fails_cleanly(folder, "No space left on device"); });
    ::umount2(folder.c_str(), MNT_DETACH);
    EXPECT_TRUE(good);
}

TEST_F(Atomic, file_size_limit_leaves_nothing) {
    EXPECT_TRUE(in_child([&] {
        std::signal(SIGXFSZ, SIG_IGN);
        const rlimit limit{100'000, 100'000};
        return ::setrlimit(RLIMIT_FSIZE, &limit) == 0 && fails_cleanly(folder, "File too large");
    }));
}

/// The last bytes of a file are written when it is closed: every size of room in turn.
TEST_F(Atomic, file_size_limit_at_any_byte) {
    write_pgbox(path("whole.pgbox.h5"), sample_pgbox(), false);
    const auto size = std::filesystem::file_size(path("whole.pgbox.h5"));
    std::filesystem::remove(path("whole.pgbox.h5"));
    EXPECT_TRUE(in_child([&] {
        std::signal(SIGXFSZ, SIG_IGN);
        for (std::uintmax_t room = 0; room < size; room += 97) {
            const rlimit limit{room, RLIM_INFINITY};
            if (::setrlimit(RLIMIT_FSIZE, &limit) != 0)
                return false;
            try {
                write_pgbox(path("a.pgbox.h5"), sample_pgbox(), false);
                return false;
            } catch (const Error& error) {
                if (error.code() != ExitCode::run_failed || file_count() != 0)
                    return false;
            }
        }
        return true;
    }));
}

} // namespace
} // namespace talus::io::test
