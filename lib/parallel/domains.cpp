// SPDX-License-Identifier: GPL-3.0-or-later
#include "parallel/domains.hpp"

#include "base/error.hpp"

#include <algorithm>
#include <mpi.h>
#include <numeric>
#include <zoltan.h>

namespace talus::parallel {

struct Domains::State {
    Zoltan_Struct* zoltan = nullptr;
    std::span<const Vec3> points;
    std::span<const float> weights;
    bool is_cut = false;
    int rank = 0;
    Vec3 lower, upper; ///< of this rank's part
};

namespace {

void check(int result, const char* what) {
    if (result != ZOLTAN_OK && result != ZOLTAN_WARN)
        throw Error(ExitCode::run_failed, std::string("the partitioning library could not ") + what +
                                              ": use another number of ranks");
}

} // namespace

Domains::Domains(const Communicator& world) : state_(std::make_unique<State>()) {
    if (world.alone())
        return;
    state_->rank = world.rank();
    float version = 0;
    check(Zoltan_Initialize(0, nullptr, &version), "start");
    Zoltan_Struct* z = state_->zoltan = Zoltan_Create(*static_cast<const MPI_Comm*>(world.handle()));
    if (z == nullptr)
        throw Error(ExitCode::run_failed, "the partitioning library could not start: out of memory");
    for (const auto& [key, value] : {std::pair{"DEBUG_LEVEL", "0"},
                                     {"LB_METHOD", "RCB"},
                                     {"KEEP_CUTS", "1"},
                                     {"OBJ_WEIGHT_DIM", "1"},
                                     {"RETURN_LISTS", "NONE"},
                                     {"NUM_GID_ENTRIES", "1"},
                                     {"NUM_LID_ENTRIES", "0"},
                                     {"RCB_RECTILINEAR_BLOCKS", "0"},
                                     {"IMBALANCE_TOL", "1.01"}})
        check(Zoltan_Set_Param(z, key, value), "take its settings");
    Zoltan_Set_Num_Obj_Fn(
        z,
        [](void* data, int* error) {
            *error = ZOLTAN_OK;
            return static_cast<int>(static_cast<State*>(data)->points.size());
        },
        state_.get());
    Zoltan_Set_Obj_List_Fn(
        z,
        [](void* data, int, int, ZOLTAN_ID_PTR ids, ZOLTAN_ID_PTR, int, float* weights, int* error) {
            const State& s = *static_cast<State*>(data);
            std::iota(ids, ids + s.points.size(), ZOLTAN_ID_TYPE{0});
            std::copy(s.weights.begin(), s.weights.end(), weights);
            *error = ZOLTAN_OK;
        },
        state_.get());
    Zoltan_Set_Num_Geom_Fn(
        z,
        [](void*, int* error) {
            *error = ZOLTAN_OK;
            return 3;
        },
        nullptr);
    Zoltan_Set_Geom_Multi_Fn(
        z,
        [](void* data, int, int, int count, ZOLTAN_ID_PTR ids, ZOLTAN_ID_PTR, int, double* out, int* error) {
            const State& s = *static_cast<State*>(data);
            for (int k = 0; k < count; ++k)
                for (int d = 0; d < 3; ++d)
                    out[3 * k + d] = s.points[ids[k]][d];
            *error = ZOLTAN_OK;
        },
        state_.get());
}

Domains::~Domains() {
    int ended = 0;
    if (state_->zoltan != nullptr && MPI_Finalized(&ended) == MPI_SUCCESS && !ended)
        Zoltan_Destroy(&state_->zoltan);
}

void Domains::cut(std::span<const Vec3> points, std::span<const float> weights) {
    if (state_->zoltan == nullptr)
        return;
    state_->points = points;
    state_->weights = weights;
    int changes = 0, gid_entries = 0, lid_entries = 0, imports = 0, exports = 0;
    ZOLTAN_ID_PTR import_gids = nullptr, import_lids = nullptr, export_gids = nullptr, export_lids = nullptr;
    int *import_ranks = nullptr, *import_parts = nullptr, *export_ranks = nullptr, *export_parts = nullptr;
    check(Zoltan_LB_Partition(state_->zoltan, &changes, &gid_entries, &lid_entries, &imports, &import_gids,
                              &import_lids, &import_ranks, &import_parts, &exports, &export_gids,
                              &export_lids, &export_ranks, &export_parts),
          "cut the domain");
    Zoltan_LB_Free_Part(&import_gids, &import_lids, &import_ranks, &import_parts);
    Zoltan_LB_Free_Part(&export_gids, &export_lids, &export_ranks, &export_parts);
    state_->is_cut = true;
    int dimensions = 0;
    Vec3 &lower = state_->lower, &upper = state_->upper;
    check(Zoltan_RCB_Box(state_->zoltan, state_->rank, &dimensions, &lower.x, &lower.y, &lower.z, &upper.x,
                         &upper.y, &upper.z),
          "tell a rank's part");
}

int Domains::rank_of(const Vec3& point) const {
    if (!state_->is_cut)
        return 0;
    const Vec3 &lower = state_->lower, &upper = state_->upper; // most are where they were
    if (lower.x < point.x && point.x < upper.x && lower.y < point.y && point.y < upper.y &&
        lower.z < point.z && point.z < upper.z)
        return state_->rank;
    double x[3] = {point.x, point.y, point.z};
    int rank = 0;
    check(Zoltan_LB_Point_Assign(state_->zoltan, x, &rank), "place a particle");
    return rank;
}

} // namespace talus::parallel
