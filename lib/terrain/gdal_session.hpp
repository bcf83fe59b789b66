// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>

namespace talus::terrain {

/// Registers GDAL's drivers once and silences its printing; failures come back through last_gdal_message().
void start_gdal();

/// GDAL's last error on one line, or "unknown reason".
std::string last_gdal_message();

/// Short readable name of a system given as WKT ("NAD83 / Washington South (EPSG:32149)").
std::string system_name(const std::string& wkt);

} // namespace talus::terrain
