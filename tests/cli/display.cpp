// SPDX-License-Identifier: GPL-3.0-or-later
#include "base/error.hpp"
#include "cli/nearest.hpp"
#include "cli/plot.hpp"
#include "cli/progress.hpp"
#include "cli/signals.hpp"
#include "run_tool.hpp"
#include <csignal>
#include <thread>

using namespace talus;
using namespace talus::cli;

namespace {

TEST(Progress, modes) {
    const auto shown = [](const std::string& mode, bool quiet) {
        testing::internal::CaptureStderr();
        {
            Progress progress("settle", mode, quiet);
            for (int k = 0; k <= 100; ++k)
                progress.update(k / 100.0, "step");
            progress.update(1.0);
        }
        return testing::internal::GetCapturedStderr();
    };
    EXPECT_EQ(shown("auto", false), "") << "stderr is no terminal here";
    EXPECT_EQ(shown("none", false), "");
    EXPECT_EQ(shown("bar", true), "");
    const std::string bar = shown("bar", false);
    EXPECT_NE(bar.find("settle ["), std::string::npos) << bar;
    EXPECT_NE(bar.find("100%"), std::string::npos);
    EXPECT_TRUE(bar.ends_with("\r\033[K")) << "the line is cleared at the end";
    const std::string lines = shown("json", false);
    ASSERT_EQ(std::ranges::count(lines, '\n'), 1) << "throttled to one a second, and the end: " << lines;
    const auto line = nlohmann::json::parse(lines);
    EXPECT_EQ(line["label"], "settle");
    EXPECT_EQ(line["fraction"], 1.0);
    EXPECT_EQ(line["detail"], "step");
    EXPECT_THROW(Progress("x", "loud", false), Error);
}

TEST(Progress, remaining_time) {
    testing::internal::CaptureStderr();
    {
        Progress progress("x", "json", false);
        std::this_thread::sleep_for(std::chrono::milliseconds(1050));
        progress.update(0.25);
        progress.update(0.5);
    }
    const auto line = nlohmann::json::parse(testing::internal::GetCapturedStderr());
    EXPECT_EQ(line["fraction"], 0.25);
    EXPECT_NEAR(line["remaining"].get<double>(), 3 * line["elapsed"].get<double>(), 1e-9);
}

TEST(Progress, durations) {
    EXPECT_EQ(format_duration(41.7), "42s");
    EXPECT_EQ(format_duration(187), "3m07s");
    EXPECT_EQ(format_duration(7500), "2h05m");
    EXPECT_EQ(format_duration(273600), "3d04h");
    EXPECT_EQ(format_duration(-1), "?");
}

TEST(Signals, ask_to_stop) {
    for (const int signal : {SIGTERM, SIGUSR1, SIGINT}) {
        install_stop_handler();
        EXPECT_FALSE(stop_requested());
        raise(signal);
        EXPECT_TRUE(stop_requested());
        EXPECT_EQ(stop_signal(), signal);
    }
    EXPECT_THROW(throw_if_stop_requested(), Stopped);
    struct sigaction now {};
    sigaction(SIGINT, nullptr, &now);
    EXPECT_EQ(now.sa_handler, SIG_DFL) << "a second Ctrl-C ends the program";
    std::signal(SIGUSR1, SIG_DFL), std::signal(SIGTERM, SIG_DFL);
}

TEST(Plot, writes_each_kind_and_leaves_no_temporary) {
    const Scratch scratch;
    const std::string script = "$data << EOD\n1 1\n2 4\n3 9\nEOD\nset title " + gnuplot_quote("it's") +
                               "\nplot $data using 1:2 with lines title 'squares'";
    gnuplot(script, scratch / "a b's.svg", 400, 300);
    EXPECT_NE(slurp(scratch / "a b's.svg").find("</svg>"), std::string::npos);
    gnuplot(script, scratch / "p.png", 400, 300);
    EXPECT_EQ(slurp(scratch / "p.png").substr(1, 3), "PNG");
    gnuplot(script, scratch / "p.pdf", 400, 300);
    EXPECT_TRUE(slurp(scratch / "p.pdf").starts_with("%PDF"));
    EXPECT_EQ(scratch.files(), 3u);
}

TEST(Plot, large_data_do_not_block) {
    const Scratch scratch;
    std::string script = "$data << EOD\n";
    for (int k = 0; k < 100000; ++k)
        script += std::to_string(k) + " 1\n";
    gnuplot(script + "EOD\nplot $data with dots notitle", scratch / "p.png", 200, 100);
    EXPECT_GT(slurp(scratch / "p.png").size(), 0u);
}

TEST(Plot, gnuplots_message_is_passed_on) {
    const Scratch scratch;
    const auto complaint = [&](const std::string& script, const std::string& path) {
        try {
            gnuplot(script, path, 100, 100);
        } catch (const Error& error) {
            return std::pair(static_cast<int>(error.code()), std::string(error.what()));
        }
        return std::pair(0, std::string());
    };
    const auto [code, message] =
        complaint("plot sin(x) with nonsense\n" + std::string(1 << 20, '#'), scratch / "p.svg");
    EXPECT_EQ(code, 1);
    EXPECT_TRUE(message.starts_with(scratch / "p.svg" + ": plot not written: gnuplot: line 3")) << message;
    EXPECT_EQ(message.find('\n'), std::string::npos);
    EXPECT_EQ(complaint("plot x", scratch / "p.gif").first, 2);
    EXPECT_EQ(complaint("plot x", scratch / "none/p.svg").first, 1);
    EXPECT_EQ(complaint("", scratch / "p.svg").first, 1) << "nothing plotted";
    EXPECT_EQ(scratch.files(), 0u);
}

TEST(Nearest, edits_and_names) {
    EXPECT_EQ(edit_distance("kitten", "sitting"), 3u);
    EXPECT_EQ(edit_distance("abcd", "acbd"), 1u) << "a swap is one edit";
    EXPECT_EQ(edit_distance("", "abc"), 3u);
    const std::vector<std::string> names = {"material.density", "radius", "radius_min_ratio"};
    EXPECT_EQ(nearest("raduis", names), "radius");
    EXPECT_EQ(nearest("densty", names), "material.density");
    EXPECT_EQ(nearest("colour", names), "");
}

} // namespace
