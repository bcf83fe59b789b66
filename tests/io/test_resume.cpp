// SPDX-License-Identifier: GPL-3.0-or-later
#include "same_files.hpp"
#include "samples.hpp"

#include "io/atomic_file.hpp"

#include <csignal>
#include <sys/wait.h>

namespace talus::io::test {
namespace {

constexpr std::size_t particles = 30;
constexpr int whole_run = 16; ///< parts of a run; 3200 rows of series, three full chunks

/// A run between two points of it: stages, series, breakages, frames.
void write(TrajectoryWriter& writer, int from, int to) {
    for (int k = from; k < to; ++k) {
        if (k % 4 == 0)
            writer.stage({"stage " + std::to_string(k), k, 0.5 * k});
        for (int row = 0; row < 200; ++row)
            writer.series(
                {{"walls/floor/force_z", k * row}, {"step", 200 * k + row}, {"time", 0.01 * row + k}});
        std::vector<BondBreakage> broken;
        for (int b = 0; b < 150 * (k % 3); ++b)
            broken.push_back({k, 0.5 * k, b, b + 1, {1.0 * b, 2, 3}, 1});
        writer.bond_breakages(broken);
        if (k % 3 == 0)
            writer.frame(
                k, 0.5 * k,
                {{"velocity", sample_frame(particles, -k)}, {"position", sample_frame(particles, k)}});
    }
}

TrajectoryWriter begin(const std::string& path) {
    return {path, sample_statics(particles), sample_provenance(), "{}", false};
}

TrajectoryWriter resume(const std::string& path, const TrajectoryImage& image, bool overwrite = false) {
    return TrajectoryWriter::resume(path, image, sample_statics(particles), sample_provenance(), "{}",
                                    overwrite);
}

class Resume : public FileTest {
protected:
    void SetUp() override {
        FileTest::SetUp();
        TrajectoryWriter writer = begin(path("whole.traj.h5"));
        write(writer, 0, whole_run);
        writer.finish();
    }
    std::string name() const { return path("a.traj.h5"); }
    std::string part() const { return partial_path(name()); }

    /// Writes up to `point`, takes the image, writes on and leaves the file.
    TrajectoryImage interrupt(int point, int end = whole_run) const {
        TrajectoryWriter writer = begin(name());
        write(writer, 0, point);
        TrajectoryImage image = writer.image();
        write(writer, point, end);
        writer.suspend();
        return image;
    }
    void expect_whole_after(const TrajectoryImage& image, int point) const {
        TrajectoryWriter writer = resume(name(), image);
        write(writer, point, whole_run);
        writer.finish();
        EXPECT_EQ(trajectory_difference(path("whole.traj.h5"), name()), "") << "point " << point;
        EXPECT_FALSE(std::filesystem::exists(part()));
        std::filesystem::remove(name());
    }
};

TEST_F(Resume, at_any_point) {
    for (int point = 0; point < whole_run; ++point)
        expect_whole_after(interrupt(point), point);
}

TEST_F(Resume, whatever_became_of_bytes_that_may_change) {
    for (const int point : {0, 6, 11, 15}) {
        const TrajectoryImage image = interrupt(point);
        std::string bytes = bytes_of(part());
        for (const Extent& range : image.ranges) // 4 bytes before each tell whose file it is
            for (std::uint64_t at = range.offset + (range.offset > 0 ? 4 : 0); at < range.offset + range.size;
                 ++at)
                bytes[at] = static_cast<char>(bytes[at] + 1 + at % 7);
        for (std::uint64_t at = image.length; at < bytes.size(); ++at)
            bytes[at] = 'r';
        put_bytes(part(), bytes + "rubbish");
        expect_whole_after(image, point);
    }
}

TEST_F(Resume, cut_off_anywhere_behind) {
    const TrajectoryImage image = interrupt(7);
    const std::string bytes = bytes_of(part());
    ASSERT_GT(bytes.size(), image.length + 3000);
    for (const std::uint64_t size : {image.length, image.length + 1, image.length + 1777, bytes.size() - 1}) {
        put_bytes(part(), bytes.substr(0, size));
        expect_whole_after(image, 7);
    }
}

/// What the image holds up to the file's end may be missing: HDF5 cuts off room that it took and did not use.
TEST_F(Resume, cut_off_within_what_the_image_holds) {
    int met = 0;
    for (int point = 0; point < whole_run; ++point) {
        const TrajectoryImage image = interrupt(point);
        const Extent last = image.ranges.back();
        if (last.offset == 0 || last.offset + last.size < image.length) {
            std::filesystem::remove(part());
            continue;
        }
        ++met;
        const std::string bytes = bytes_of(part());
        put_bytes(part(), bytes.substr(0, last.offset + 3));
        expect_error(ExitCode::input_invalid, {"a.traj.h5", "bytes"}, [&] { resume(name(), image); });
        put_bytes(part(), bytes.substr(0, last.offset + 4)); // 4 tell whose file it is
        expect_whole_after(image, point);
    }
    EXPECT_GT(met, 0);
}

TEST_F(Resume, again_and_again) {
    TrajectoryImage image = interrupt(2, 5);
    for (int point = 2; point < 14; point += 3) {
        TrajectoryWriter writer = resume(name(), image);
        write(writer, point, point + 3);
        image = writer.image();
        write(writer, point + 3, point + 5);
        writer.suspend();
    }
    expect_whole_after(image, 14);
}

/// The checkpoint before the last one serves, too.
TEST_F(Resume, from_an_earlier_image) {
    const TrajectoryImage first = interrupt(4);
    {
        TrajectoryWriter writer = resume(name(), first);
        write(writer, 4, 9);
        (void)writer.image();
        write(writer, 9, 12);
        writer.suspend();
    }
    expect_whole_after(first, 4);
}

TEST_F(Resume, killed_while_writing) {
    for (const int point : {3, 10}) {
        const std::string saved = path("a.ckpt.h5");
        const pid_t child = ::fork();
        if (child == 0) {
            TrajectoryWriter writer = begin(name());
            write(writer, 0, point);
            CheckpointFile checkpoint = sample_checkpoint();
            put(checkpoint, writer.image());
            write_checkpoint(saved, checkpoint);
            for (;;)
                write(writer, point, whole_run);
        }
        while (!std::filesystem::exists(saved) || std::filesystem::file_size(part()) < 200'000)
            ::usleep(1000);
        ::kill(child, SIGKILL);
        int status = 0;
        ::waitpid(child, &status, 0);
        ASSERT_TRUE(WIFSIGNALED(status));
        const CheckpointReader reader(saved);
        expect_whole_after(trajectory_image(reader).value(), point);
        std::filesystem::remove(saved);
    }
}

TEST_F(Resume, image_is_small_and_survives_a_checkpoint) {
    const std::size_t n = 20'000;
    TrajectoryWriter writer(name(), sample_statics(n), {}, "", false);
    write_frames(writer, n, 30);
    const TrajectoryImage image = writer.image();
    EXPECT_GT(image.length, 60u * 12 * n);
    EXPECT_LT(image.bytes.size(), 200'000u);
    CheckpointFile checkpoint = sample_checkpoint();
    write_checkpoint(path("without.ckpt.h5"), checkpoint);
    put(checkpoint, image);
    write_checkpoint(path("with.ckpt.h5"), checkpoint);
    EXPECT_EQ(trajectory_image(CheckpointReader(path("without.ckpt.h5"))), std::nullopt);
    EXPECT_EQ(trajectory_image(CheckpointReader(path("with.ckpt.h5"))), image);
}

TEST_F(Resume, what_does_not_fit_is_refused_and_left) {
    TrajectoryImage image = interrupt(7);
    const std::string bytes = bytes_of(part());
    const auto refused = [&](const std::vector<std::string>& words, const std::function<void()>& action) {
        expect_error(ExitCode::input_invalid, words, action);
        EXPECT_TRUE(std::filesystem::exists(part()));
        put_bytes(part(), bytes);
    };
    put_bytes(part(), bytes.substr(0, image.length - 1));
    refused({part(), std::to_string(image.length - 1), std::to_string(image.length)},
            [&] { resume(name(), image); });
    std::string other = bytes;
    other[image.ranges[1].offset] ^= 1;
    put_bytes(part(), other);
    refused({part(), "another run"}, [&] { resume(name(), image); });
    refused({part(), "/particles/all/radius", "30 rows", "29"},
            [&] { TrajectoryWriter::resume(name(), image, sample_statics(29), {}, "", false); });
    TrajectoryStatic statics = sample_statics(particles);
    statics.mass.clear();
    refused({part(), "/particles/all/mass"},
            [&] { TrajectoryWriter::resume(name(), image, statics, {}, "", false); });
    statics = sample_statics(particles);
    statics.float64 = true;
    refused({part(), "precision", "output.float64"},
            [&] { TrajectoryWriter::resume(name(), image, statics, {}, "", false); });
    refused({name(), "1 fields after one with 2"}, [&] {
        resume(name(), image).frame(7, 3.5, {{"position", sample_frame(particles, 7)}});
    });
    refused({name(), "with b where "}, [&] {
        resume(name(), image).series({{"step", 0}, {"time", 0}, {"b", 1}});
    });
    TrajectoryImage broken = image;
    broken.bytes.pop_back();
    refused({part(), "contradicts itself"}, [&] { resume(name(), broken); });
    put_bytes(name(), "precious");
    expect_error(ExitCode::output_exists, {name()}, [&] { resume(name(), image); });
    EXPECT_EQ(bytes_of(part()), bytes);
    std::filesystem::remove(name());
    std::filesystem::remove(part());
    expect_error(ExitCode::input_invalid, {part(), "No such file"}, [&] { resume(name(), image); });
    EXPECT_FALSE(std::filesystem::exists(part()));
}

TEST_F(Resume, a_failure_after_an_image_leaves_the_file) {
    TrajectoryImage image;
    {
        TrajectoryWriter writer = begin(name());
        write(writer, 0, 5);
        image = writer.image();
        auto rows = sample_frame(particles, 0);
        rows[4].x = std::nan("");
        expect_error(ExitCode::run_failed, {"row 4"}, [&] {
            writer.frame(7, 0, {{"velocity", rows}, {"position", rows}});
        });
    }
    expect_whole_after(image, 5);
}

TEST(Extents, complement) {
    using List = std::vector<Extent>;
    EXPECT_EQ(complement({}, 10), (List{{0, 10}}));
    EXPECT_EQ(complement({{4, 2}, {0, 4}}, 6), List{});
    EXPECT_EQ(complement({{7, 2}, {2, 3}, {3, 1}}, 10), (List{{0, 2}, {5, 2}, {9, 1}}));
    EXPECT_EQ(complement(complement({{2, 3}, {7, 2}}, 10), 10), (List{{2, 3}, {7, 2}}));
}

// ---- parts of checkpoints and models

TEST_F(Resume, parts_of_a_checkpoint) {
    const CheckpointFile file = sample_checkpoint();
    write_checkpoint(path("a.ckpt.h5"), file);
    const CheckpointReader reader(path("a.ckpt.h5"));
    EXPECT_EQ(reader.attributes(), file.attributes);
    EXPECT_EQ(reader.config(), file.config);
    EXPECT_EQ(reader.provenance().size(), file.provenance.size());
    ASSERT_EQ(reader.names().size(), file.columns.size());
    EXPECT_EQ(reader.names()[1], "id");
    EXPECT_EQ(reader.rows("particles/position"), 2u);
    EXPECT_EQ(reader.width("particles/position"), 3u);
    EXPECT_EQ(reader.rows("nothing"), 0u);
    EXPECT_FALSE(reader.has("bonds"));
    EXPECT_EQ(reader.read("particles/position", 1, 1),
              (Column{"particles/position", std::vector<double>{4, 5, 6}, 3, "m", {1, 2}}));
    EXPECT_EQ(reader.read("particles/position", 2, 0),
              (Column{"particles/position", std::vector<double>{}, 3, "m", {2, 2}}));
    EXPECT_EQ(reader.read("id"), file.columns[1]);
    expect_error(ExitCode::input_invalid, {"a.ckpt.h5", "id", "has 2 rows, 1 to 3"},
                 [&] { reader.read("id", 1, 2); });
    expect_error(ExitCode::input_invalid, {"a.ckpt.h5", "bonds", "missing"}, [&] { reader.read("bonds"); });
}

TEST_F(Resume, part_of_a_column_alone_is_a_mistake) {
    CheckpointFile file;
    file.columns = {{"id", std::vector<double>{1, 2}, 1, "", {0, 3}}};
    expect_error(ExitCode::run_failed, {"a.ckpt.h5", "id", "2 rows of 3"},
                 [&] { write_checkpoint(path("a.ckpt.h5"), file); });
    EXPECT_FALSE(std::filesystem::exists(partial_path(path("a.ckpt.h5"))));
}

TEST_F(Resume, parts_of_a_model) {
    const Grains grains = sample_grains(40);
    write_model(path("a.model.h5"), {grains, sample_provenance(), "{}"}, false);
    for (const int size : {1, 3, 64}) {
        Grains joined;
        for (int rank = 0; rank < size; ++rank) {
            const ModelFile file = read_model(path("a.model.h5"), {rank, size});
            const Grains& part = std::get<Grains>(file.model);
            EXPECT_EQ(file.total, 40u);
            EXPECT_EQ(file.first, joined.size());
            EXPECT_EQ(part.size(), static_cast<std::size_t>(40 * (rank + 1) / size - 40 * rank / size));
            EXPECT_EQ(part.contacts.size(), size == 1 ? grains.contacts.size() : 0);
            EXPECT_EQ(part.origin, grains.origin);
            EXPECT_EQ(part.box, grains.box);
            const auto add = [](auto& to, const auto& from) {
                to.insert(to.end(), from.begin(), from.end());
            };
            add(joined.position, part.position);
            add(joined.radius, part.radius);
            add(joined.mass, part.mass);
            add(joined.velocity, part.velocity);
            add(joined.angular_velocity, part.angular_velocity);
            add(joined.species, part.species);
            add(joined.release, part.release);
            add(joined.material, part.material);
        }
        EXPECT_EQ(joined.position, grains.position);
        EXPECT_EQ(joined.radius, grains.radius);
        EXPECT_EQ(joined.mass, grains.mass);
        EXPECT_EQ(joined.velocity, grains.velocity);
        EXPECT_EQ(joined.angular_velocity, grains.angular_velocity);
        EXPECT_EQ(joined.species, grains.species);
        EXPECT_EQ(joined.release, grains.release);
        EXPECT_EQ(joined.material, grains.material);
    }
    write_model(path("b.model.h5"), {sample_tiled(), {}, ""}, false);
    const ModelFile tiled = read_model(path("b.model.h5"), {1, 3});
    EXPECT_EQ(std::get<TiledModel>(tiled.model).size(), 20u);
    EXPECT_EQ(tiled.total, 20u);
}

} // namespace
} // namespace talus::io::test
