// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>

namespace talus::cli {

/// @throws Error(usage) unless the name ends in .svg, .png or .pdf; call it before long work.
void check_plot_path(const std::string& output_path);

/// Runs gnuplot on the commands of script_body (data as here-documents: $name << EOD ...), with terminal (by
/// the extension .svg, .png or .pdf) and output set before them. Written under a temporary name, then
/// renamed.
/// @throws Error(usage) for another extension; Error(run_failed) with gnuplot's own message where it fails.
void gnuplot(const std::string& script_body, const std::string& output_path, int width_px, int height_px);

/// Text in single quotes for a gnuplot script.
std::string gnuplot_quote(const std::string& text);

} // namespace talus::cli
