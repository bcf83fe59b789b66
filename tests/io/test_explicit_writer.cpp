// SPDX-License-Identifier: GPL-3.0-or-later
#include "samples.hpp"

#include "io/explicit_file.hpp"
#include "io/quick_check.hpp"

#include <algorithm>
#include <bit>
#include <csignal>
#include <random>
#include <sys/resource.h>
#include <variant>

namespace talus::io::test {
namespace {

using Explicit = FileTest;

/// More than a chunk of each column: noise, which deflate cannot shorten, steps, zeros, and numbers whose
/// words add up to nothing modulo 65535, as a Fletcher sum takes them.
Grains many_grains() {
    constexpr std::size_t n = 4'500'000, contacts = 1'500'000;
    const double nothing = std::bit_cast<double>(std::uint64_t{0x3ff000000000c00f});
    std::mt19937_64 random(7);
    Grains grains;
    grains.position.resize(n);
    grains.radius.resize(n);
    grains.release.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
        if (i % 1000 == 0)
            grains.position[i] = {static_cast<double>(random() % 1000), 1.5, -static_cast<double>(i)};
        grains.radius[i] = 1 + static_cast<double>(i < 1'000'000 ? random() % (1u << 30) : i / 1000);
        grains.release[i] = static_cast<std::uint8_t>(i / 1000 % 3 == 0);
    }
    ContactTable& table = grains.contacts;
    table.pair.resize(contacts);
    table.image.resize(contacts);
    table.normal_overlap.assign(contacts, nothing);
    for (std::size_t c = 0; c < contacts; ++c) {
        table.pair[c] = {static_cast<std::int64_t>(3 * c),
                         static_cast<std::int64_t>(std::min(3 * c + 1 + random() % 400'000, n - 1))};
        table.image[c] = {static_cast<std::int8_t>(-1), static_cast<std::int8_t>(c % 2), 0};
    }
    return grains;
}

/// Rows [first, last) with the contacts that begin there.
Grains part_of(const Grains& all, std::size_t first, std::size_t last) {
    const auto cut = [&](const auto& column) {
        return std::vector(column.begin() + static_cast<std::ptrdiff_t>(first),
                           column.begin() + static_cast<std::ptrdiff_t>(last));
    };
    Grains grains;
    grains.position = cut(all.position);
    grains.radius = cut(all.radius);
    grains.release = cut(all.release);
    for (std::size_t c = 0; c < all.contacts.size(); ++c) {
        const auto i = static_cast<std::size_t>(all.contacts.pair[c][0]);
        if (i < first || i >= last)
            continue;
        grains.contacts.pair.push_back(all.contacts.pair[c]);
        grains.contacts.image.push_back(all.contacts.image[c]);
        grains.contacts.normal_overlap.push_back(all.contacts.normal_overlap[c]);
    }
    return grains;
}

/// HDF5's own filters undo what the press did, and test its checksums.
TEST_F(Explicit, WholeChunksAreReadAsTheyWere) {
    const Grains grains = many_grains();
    for (const int threads : {1, 3}) {
        ThreadTeam team(threads);
        ExplicitFrame frame;
        frame.release = true;
        ExplicitWriter writer(path(std::to_string(threads) + ".model.h5"), frame, {}, "{}", false, team);
        for (const auto& [first, last] : {std::pair{0, 700'001}, {700'001, 700'002}, {700'002, 4'500'000}})
            writer.add(part_of(grains, static_cast<std::size_t>(first), static_cast<std::size_t>(last)));
        writer.finish();
    }
    const std::string one = bytes_of(path("1.model.h5"));
    EXPECT_TRUE(one == bytes_of(path("3.model.h5")));
    EXPECT_LT(one.size(), std::size_t{150'000'000}); // of 189 MB
    check_all(path("1.model.h5"));
    const Grains back = std::get<Grains>(read_model(path("1.model.h5")).model);
    EXPECT_TRUE(back.position == grains.position);
    EXPECT_TRUE(back.radius == grains.radius);
    EXPECT_TRUE(back.release == grains.release);
    EXPECT_TRUE(back.contacts.pair == grains.contacts.pair);
    EXPECT_TRUE(back.contacts.image == grains.contacts.image);
    EXPECT_TRUE(back.contacts.normal_overlap == grains.contacts.normal_overlap);
}

/// A chunk that cannot be written ends all threads, and nothing is left.
TEST_F(Explicit, AFileThatMayNotGrowIsAnErrorAndLeavesNothing) {
    const Grains grains = part_of(many_grains(), 0, 1'000'000);
    ThreadTeam team(3);
    rlimit usual{};
    ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &usual), 0);
    const auto handler = std::signal(SIGXFSZ, SIG_IGN);
    const rlimit small{10'000'000, usual.rlim_max};
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
    expect_error(ExitCode::run_failed, {"a.model.h5"}, [&] {
        ExplicitWriter writer(path("a.model.h5"), {}, {}, "{}", false, team);
        writer.add(grains);
        writer.finish();
    });
    ::setrlimit(RLIMIT_FSIZE, &usual);
    std::signal(SIGXFSZ, handler);
    EXPECT_EQ(file_count(), 0u);
}

} // namespace
} // namespace talus::io::test
