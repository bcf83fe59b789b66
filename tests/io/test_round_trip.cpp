// SPDX-License-Identifier: GPL-3.0-or-later
#include "samples.hpp"

#include "io/atomic_file.hpp"
#include "io/quick_check.hpp"

#include <cmath>
#include <cstring>
#include <limits>

namespace talus::io::test {
namespace {

using RoundTrip = FileTest;

void expect_same(const Provenance& a, const Provenance& b) {
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i) {
        EXPECT_EQ(a[i].program, b[i].program);
        EXPECT_EQ(a[i].version, b[i].version);
        EXPECT_EQ(a[i].command_line, b[i].command_line);
        EXPECT_EQ(a[i].config, b[i].config);
        EXPECT_EQ(a[i].seed, b[i].seed);
        EXPECT_EQ(a[i].inputs, b[i].inputs);
    }
}

void expect_same(const ContactTable& a, const ContactTable& b) {
    EXPECT_EQ(a.pair, b.pair);
    EXPECT_EQ(a.image, b.image);
    EXPECT_EQ(a.normal_overlap, b.normal_overlap);
}

void expect_same(const PgBox& a, const PgBox& b) {
    EXPECT_EQ(a.length, b.length);
    EXPECT_EQ(a.density, b.density);
    EXPECT_EQ(a.position, b.position);
    EXPECT_EQ(a.radius, b.radius);
    expect_same(a.contacts, b.contacts);
}

TEST_F(RoundTrip, pgbox) {
    const PgBoxFile file = sample_pgbox();
    write_pgbox(path("a.pgbox.h5"), file, false);
    const PgBoxFile back = read_pgbox(path("a.pgbox.h5"));
    expect_same(back.box, file.box);
    EXPECT_EQ(back.attributes, file.attributes);
    EXPECT_EQ(back.history, file.history);
    EXPECT_EQ(back.grading.diameter, file.grading.diameter);
    EXPECT_EQ(back.grading.fraction_finer, file.grading.fraction_finer);
    EXPECT_EQ(back.asked_grading.diameter, file.asked_grading.diameter);
    EXPECT_EQ(back.asked_grading.fraction_finer, file.asked_grading.fraction_finer);
    EXPECT_EQ(back.config, file.config);
    expect_same(back.provenance, file.provenance);
    EXPECT_EQ(kind_of(path("a.pgbox.h5")), FileKind::pgbox);
    EXPECT_EQ(file_count(), 1u); // nothing temporary left
}

TEST_F(RoundTrip, pgbox_with_nothing_optional) {
    PgBoxFile file;
    file.box.position = {{0, 0, 0}};
    file.box.radius = {0.1};
    write_pgbox(path("one.pgbox.h5"), file, false);
    const PgBoxFile back = read_pgbox(path("one.pgbox.h5"));
    expect_same(back.box, file.box);
    EXPECT_TRUE(back.attributes.empty() && back.history.empty() && back.provenance.empty() &&
                back.config.empty() && back.grading.diameter.empty() && back.asked_grading.diameter.empty());
}

TEST_F(RoundTrip, explicit_model) {
    const Grains grains = sample_grains();
    write_model(path("a.model.h5"), {grains, sample_provenance(), "{}"}, false);
    const ModelFile file = read_model(path("a.model.h5"));
    ASSERT_FALSE(file.tiled());
    const Grains& back = std::get<Grains>(file.model);
    EXPECT_EQ(back.position, grains.position);
    EXPECT_EQ(back.radius, grains.radius);
    EXPECT_EQ(back.mass, grains.mass);
    EXPECT_EQ(back.velocity, grains.velocity);
    EXPECT_EQ(back.angular_velocity, grains.angular_velocity);
    EXPECT_EQ(back.species, grains.species);
    EXPECT_EQ(back.release, grains.release);
    EXPECT_EQ(back.material, grains.material);
    EXPECT_EQ(back.origin, grains.origin);
    EXPECT_EQ(back.coordinate_system, grains.coordinate_system);
    EXPECT_EQ(back.box, grains.box);
    expect_same(back.contacts, grains.contacts);
    expect_same(file.provenance, sample_provenance());
}

TEST_F(RoundTrip, smallest_explicit_model) {
    Grains grains;
    grains.position = {{1e6, 2, 3}};
    grains.radius = {0.5};
    write_model(path("a.model.h5"), {grains, {}, ""}, false);
    const Grains back = std::get<Grains>(read_model(path("a.model.h5")).model);
    EXPECT_EQ(back.position, grains.position);
    EXPECT_TRUE(back.mass.empty() && back.velocity.empty() && back.species.empty() && back.release.empty() &&
                back.material.empty());
    EXPECT_FALSE(back.box);
}

TEST_F(RoundTrip, tiled_model) {
    const TiledModel model = sample_tiled();
    write_model(path("a.model.h5"), {model, {}, ""}, false);
    const ModelFile file = read_model(path("a.model.h5"));
    ASSERT_TRUE(file.tiled());
    const TiledModel& back = std::get<TiledModel>(file.model);
    ASSERT_EQ(back.boxes.size(), 2u);
    expect_same(back.boxes[0], model.boxes[0]);
    expect_same(back.boxes[1], model.boxes[1]);
    EXPECT_EQ(back.scale, model.scale);
    EXPECT_EQ(back.origin, model.origin);
    EXPECT_EQ(back.coordinate_system, model.coordinate_system);
    EXPECT_EQ(back.domain, model.domain);
    EXPECT_EQ(back.kept_mask, model.kept_mask);
    EXPECT_EQ(back.fixed_mask, model.fixed_mask);
    EXPECT_EQ(back.release_mask, model.release_mask);
    EXPECT_EQ(back.size(), 20u);
    ASSERT_EQ(back.tiles.size(), model.tiles.size());
    for (std::size_t t = 0; t < back.tiles.size(); ++t) {
        EXPECT_EQ(back.tiles[t].index, model.tiles[t].index);
        EXPECT_EQ(back.tiles[t].box, model.tiles[t].box);
        EXPECT_EQ(back.tiles[t].kind, model.tiles[t].kind);
        EXPECT_EQ(back.tiles[t].kept, model.tiles[t].kept);
        EXPECT_EQ(back.tiles[t].first_particle, model.tiles[t].first_particle);
    }
}

TEST_F(RoundTrip, trajectory) {
    const TrajectoryStatic statics = sample_statics();
    {
        TrajectoryWriter writer(path("a.traj.h5"), statics, sample_provenance(), "{\"a\": 1}", false);
        write_frames(writer, 30, 3);
        writer.finish();
    }
    const TrajectoryReader reader(path("a.traj.h5"));
    EXPECT_EQ(reader.statics().radius, statics.radius);
    EXPECT_EQ(reader.statics().mass, statics.mass);
    EXPECT_EQ(reader.statics().species, statics.species);
    EXPECT_EQ(reader.statics().release, statics.release);
    EXPECT_EQ(reader.statics().material, statics.material);
    EXPECT_EQ(reader.statics().origin, statics.origin);
    EXPECT_EQ(reader.statics().coordinate_system, statics.coordinate_system);
    EXPECT_EQ(reader.statics().box, statics.box);
    EXPECT_FALSE(reader.statics().float64);
    EXPECT_EQ(reader.fields(), (std::vector<std::string>{"position", "velocity"}));
    ASSERT_EQ(reader.frames(), 3u);
    for (int f = 0; f < 3; ++f) {
        const auto frame = static_cast<std::size_t>(f);
        EXPECT_EQ(reader.step(frame), 10 * f);
        EXPECT_EQ(reader.time(frame), 0.1 * f);
        EXPECT_EQ(reader.read(frame, "position"), sample_frame(30, f));
        EXPECT_EQ(reader.read(frame, "velocity"), sample_frame(30, -f));
    }
    EXPECT_EQ(reader.series_names(), (std::vector<std::string>{"step", "time", "walls/floor/force_z"}));
    EXPECT_EQ(reader.series("walls/floor/force_z"), (std::vector<double>{0, 3.5, 7}));
    EXPECT_EQ(reader.series("step"), (std::vector<double>{0, 10, 20}));
    EXPECT_EQ(reader.stages(), (std::vector<StageMark>{{"settle", 0, 0}, {"slide", 20, 0.2}}));
    const auto broken = reader.bond_breakages();
    ASSERT_EQ(broken.size(), 3u);
    EXPECT_EQ(broken[2], (BondBreakage{20, 0.2, 1, 5, {1, 2, 3}, 2}));
    expect_same(reader.provenance(), sample_provenance());
    EXPECT_EQ(reader.config(), "{\"a\": 1}");
    expect_error(ExitCode::input_invalid, {"a.traj.h5", "force", "output.fields"},
                 [&] { reader.read(0, "force"); });
    expect_error(ExitCode::input_invalid, {"a.traj.h5", "triaxial/axial_strain"},
                 [&] { reader.series("triaxial/axial_strain"); });
    expect_error(ExitCode::input_invalid, {"no frame 3"}, [&] { reader.read(3, "position"); });
}

TEST_F(RoundTrip, trajectory_in_f64_keeps_every_bit) {
    TrajectoryStatic statics = sample_statics(2);
    statics.float64 = true;
    const std::vector<Vec3> rows = {{0.1, 1.0 / 3.0, 1e-300}, {-0.0, 5e6 + 1e-9, 2}};
    {
        TrajectoryWriter writer(path("a.traj.h5"), statics, {}, "", false);
        writer.frame(1, 0.5, {{"position", rows}, {"force", rows}});
        writer.finish();
    }
    const TrajectoryReader reader(path("a.traj.h5"));
    EXPECT_TRUE(reader.statics().float64);
    const auto back = reader.read(0, "force");
    EXPECT_EQ(std::memcmp(back.data(), rows.data(), sizeof(Vec3) * 2), 0);
}

TEST_F(RoundTrip, long_series_and_no_frame) {
    {
        TrajectoryWriter writer(path("a.traj.h5"), sample_statics(1), {}, "", false);
        for (int i = 0; i < 5000; ++i)
            writer.series({{"step", i}, {"time", 1e-3 * i}, {"kinetic_energy", std::sqrt(i)}});
        writer.finish();
    }
    const TrajectoryReader reader(path("a.traj.h5"));
    EXPECT_EQ(reader.frames(), 0u);
    const auto energy = reader.series("kinetic_energy");
    ASSERT_EQ(energy.size(), 5000u);
    EXPECT_EQ(energy[4999], std::sqrt(4999));
}

TEST_F(RoundTrip, checkpoint) {
    CheckpointFile file = sample_checkpoint();
    write_checkpoint(path("a.ckpt.h5"), file);
    const CheckpointFile back = read_checkpoint(path("a.ckpt.h5"));
    EXPECT_EQ(back.columns, file.columns);
    EXPECT_EQ(back.attributes, file.attributes);
    EXPECT_EQ(back.config, file.config);
    expect_same(back.provenance, file.provenance);
    EXPECT_EQ(back.get<std::int64_t>("id"), (std::vector<std::int64_t>{7, 8}));
    expect_error(ExitCode::input_invalid, {"bonds", "missing"}, [&] { back.get<double>("bonds"); });
    expect_error(ExitCode::input_invalid, {"id", "type"}, [&] { back.get<double>("id"); });
}

/// Columns made when their turn has come lie behind the others; a mistake in them leaves the checkpoint of
/// before.
TEST_F(RoundTrip, checkpoint_of_columns_made_later) {
    CheckpointFile file = sample_checkpoint();
    const std::vector<Column> group = {{"later/a", std::vector<double>{1, 2, 3, 4}, 2, "m"},
                                       {"later/b", std::vector<std::uint8_t>{5}, 1, ""}};
    int made = 0;
    file.later = {[&] { return ++made, group; },
                  [] {
                      return std::vector<Column>{{"last", std::vector<float>{6}, 1, ""}};
                  }};
    write_checkpoint(path("a.ckpt.h5"), file);
    EXPECT_EQ(made, 1);
    std::vector<Column> all = file.columns;
    all.insert(all.end(), group.begin(), group.end());
    all.push_back({"last", std::vector<float>{6}, 1, ""});
    EXPECT_EQ(read_checkpoint(path("a.ckpt.h5")).columns, all);
    file.later = {[] { return std::vector<Column>{{"odd", std::vector<double>{1, 2, 3}, 2, ""}}; }};
    expect_error(ExitCode::run_failed, {"odd", "3 values"},
                 [&] { write_checkpoint(path("a.ckpt.h5"), file); });
    file.later = {[]() -> std::vector<Column> { throw Error(ExitCode::run_failed, "no room"); }};
    expect_error(ExitCode::run_failed, {"no room"}, [&] { write_checkpoint(path("a.ckpt.h5"), file); });
    EXPECT_EQ(read_checkpoint(path("a.ckpt.h5")).columns, all);
}

TEST_F(RoundTrip, checkpoint_keeps_nan_and_negative_zero) {
    const std::vector<double> odd = {std::numeric_limits<double>::quiet_NaN(), -0.0,
                                     std::numeric_limits<double>::infinity(), 5e-324};
    CheckpointFile file;
    file.columns = {{"odd", odd, 1, ""}};
    write_checkpoint(path("a.ckpt.h5"), file);
    const auto back = read_checkpoint(path("a.ckpt.h5")).get<double>("odd");
    ASSERT_EQ(back.size(), odd.size());
    EXPECT_EQ(std::memcmp(back.data(), odd.data(), sizeof(double) * odd.size()), 0);
}

TEST_F(RoundTrip, several_chunks) {
    const PgBoxFile file = sample_pgbox(300'000); // 7 MB of positions in chunks of 4 MiB
    write_pgbox(path("a.pgbox.h5"), file, false);
    expect_same(read_pgbox(path("a.pgbox.h5")).box, file.box);
}

TEST_F(RoundTrip, texts_beyond_an_object_header) {
    PgBoxFile file = sample_pgbox();
    file.config = std::string(100'000, 'c') + "end";
    file.provenance[0].command_line = std::string(70'000, 'x');
    file.provenance[0].inputs.assign(5000, "tile.pgbox.h5 sha256 0123456789");
    write_pgbox(path("a.pgbox.h5"), file, false);
    const PgBoxFile back = read_pgbox(path("a.pgbox.h5"));
    EXPECT_EQ(back.config, file.config);
    expect_same(back.provenance, file.provenance);
}

TEST_F(RoundTrip, same_input_same_bytes) {
    const auto write_all = [&](const std::string& name) {
        std::filesystem::create_directory(folder / name);
        const auto in = [&](const std::string& file) { return (folder / name / file).string(); };
        write_pgbox(in("a.pgbox.h5"), sample_pgbox(), false);
        write_model(in("a.model.h5"), {sample_grains(), sample_provenance(), ""}, false);
        write_model(in("b.model.h5"), {sample_tiled(), {}, ""}, false);
        write_checkpoint(in("a.ckpt.h5"), sample_checkpoint());
        TrajectoryWriter writer(in("a.traj.h5"), sample_statics(), {}, "", false);
        write_frames(writer, 30, 3);
        writer.finish();
    };
    write_all("first");
    ::sleep(1); // a time stamp would show
    std::vector<char> dirt(1 << 20, 'd');
    EXPECT_EQ(dirt[77], 'd');
    write_all("second");
    for (const char* file : {"a.pgbox.h5", "a.model.h5", "a.model.xdmf", "b.model.h5", "b.model.xdmf",
                             "a.ckpt.h5", "a.traj.h5", "a.traj.xdmf"}) {
        const std::string first = bytes_of(path(std::string("first/") + file));
        EXPECT_FALSE(first.empty()) << file;
        EXPECT_EQ(first, bytes_of(path(std::string("second/") + file))) << file;
    }
}

} // namespace
} // namespace talus::io::test
