// SPDX-License-Identifier: GPL-3.0-or-later
#include "terrain/gdal_session.hpp"

#include <algorithm>
#include <cpl_error.h>
#include <gdal_priv.h>
#include <mutex>
#include <ogr_spatialref.h>
#include <ogrsf_frmts.h>

namespace talus::terrain {

void start_gdal() {
    static std::once_flag once;
    std::call_once(once, [] {
        GDALAllRegister();
        CPLSetErrorHandler(CPLQuietErrorHandler);
    });
    CPLErrorReset();
}

std::string last_gdal_message() {
    std::string message = CPLGetLastErrorMsg();
    std::replace(message.begin(), message.end(), '\n', ' ');
    return message.empty() ? "unknown reason" : message;
}

std::string system_name(const std::string& wkt) {
    OGRSpatialReference system;
    if (wkt.empty() || system.importFromWkt(wkt.c_str()) != OGRERR_NONE)
        return "an unstated system";
    const char* name = system.GetName();
    std::string text = name ? name : "an unnamed system";
    const char* authority = system.GetAuthorityName(nullptr);
    const char* code = system.GetAuthorityCode(nullptr);
    if (authority && code)
        text += std::string(" (") + authority + ":" + code + ")";
    return text;
}

} // namespace talus::terrain
