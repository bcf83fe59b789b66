// SPDX-License-Identifier: GPL-3.0-or-later
#include "packing/hertz_kernel.hpp"

#include <cmath>

// One source, compiled for AVX2 as well and chosen when the program is loaded. Both give the same bits: no
// operation is fused (-ffp-contract=off) and the lanes' order is written out. Sanitizers want no such choice.
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__) &&     \
    !defined(__SANITIZE_THREAD__)
#define TALUS_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define TALUS_CLONES
#endif
#define TALUS_INLINE inline __attribute__((always_inline))

namespace talus::packing {

namespace {

using Lanes = double __attribute__((vector_size(32)));
using Mask = long long __attribute__((vector_size(32)));

TALUS_INLINE void square_root(Lanes& v) {
    for (int l = 0; l < 4; ++l)
        v[l] = std::sqrt(v[l]);
}
/// Separation to the nearest image in the unit cube: adding and taking away 1.5 * 2^52 rounds to the nearest
/// integer. Odd in its argument, so that both ends of a pair see opposite vectors bit for bit.
TALUS_INLINE void to_nearest_image(Lanes& d) {
    constexpr double magic = 0x1.8p52;
    d -= (d + magic) - magic;
}
TALUS_INLINE double add_up(const Lanes& v) {
    return (v[0] + v[1]) + (v[2] + v[3]);
}

template <bool one_radius>
TALUS_INLINE void sum_range(const Sphere* spheres, std::size_t begin, std::size_t end,
                            const std::uint32_t* list, std::size_t k, const std::size_t* list_end,
                            PartnerSum* out) {
    const Lanes zero = {0, 0, 0, 0}, ones = {1, 1, 1, 1};
    const Lanes* records = reinterpret_cast<const Lanes*>(spheres);
    for (std::size_t i = begin; i < end; ++i) {
        const Sphere a = spheres[i];
        Lanes fx = zero, fy = zero, fz = zero, contacts = zero, force = zero, virial = zero, overlaps = zero,
              stiffness = zero;
        for (; k < list_end[i]; k += partner_group) {
            const Lanes b0 = records[list[k]], b1 = records[list[k + 1]], b2 = records[list[k + 2]],
                        b3 = records[list[k + 3]];
            const Lanes t0 = __builtin_shuffle(b0, b1, Mask{0, 4, 2, 6});
            const Lanes t1 = __builtin_shuffle(b0, b1, Mask{1, 5, 3, 7});
            const Lanes t2 = __builtin_shuffle(b2, b3, Mask{0, 4, 2, 6});
            const Lanes t3 = __builtin_shuffle(b2, b3, Mask{1, 5, 3, 7});
            Lanes dx = __builtin_shuffle(t0, t2, Mask{0, 1, 4, 5}) - a.x;
            Lanes dy = __builtin_shuffle(t1, t3, Mask{0, 1, 4, 5}) - a.y;
            Lanes dz = __builtin_shuffle(t0, t2, Mask{2, 3, 6, 7}) - a.z;
            const Lanes r = __builtin_shuffle(t1, t3, Mask{2, 3, 6, 7});
            to_nearest_image(dx);
            to_nearest_image(dy);
            to_nearest_image(dz);
            Lanes d = dx * dx + dy * dy + dz * dz;
            square_root(d);
            const Lanes reach = r + a.r;
            const Mask touching = (d < reach) & (d > zero);
            const Lanes overlap = touching ? reach - d : zero;
            const Lanes distance = touching ? d : ones;
            // slope = 2 sqrt(R overlap) = dF/d overlap;  F = 2/3 slope overlap
            Lanes slope = (one_radius ? overlap * (0.5 * a.r) : overlap * (r * a.r / reach));
            square_root(slope);
            slope += slope;
            const Lanes f = slope * overlap * (2.0 / 3.0), g = f / distance;
            fx -= g * dx;
            fy -= g * dy;
            fz -= g * dz;
            contacts += touching ? ones : zero;
            force += f;
            virial += f * distance;
            overlaps += overlap;
            stiffness += slope;
        }
        out[i - begin] = {add_up(fx),    add_up(fy),     add_up(fz),       add_up(contacts),
                          add_up(force), add_up(virial), add_up(overlaps), add_up(stiffness)};
    }
}

TALUS_CLONES void sum_one_radius(const Sphere* spheres, std::size_t begin, std::size_t end,
                                 const std::uint32_t* list, std::size_t list_begin,
                                 const std::size_t* list_end, PartnerSum* out) {
    sum_range<true>(spheres, begin, end, list, list_begin, list_end, out);
}

TALUS_CLONES void sum_many_radii(const Sphere* spheres, std::size_t begin, std::size_t end,
                                 const std::uint32_t* list, std::size_t list_begin,
                                 const std::size_t* list_end, PartnerSum* out) {
    sum_range<false>(spheres, begin, end, list, list_begin, list_end, out);
}

} // namespace

void sum_partners(const Sphere* spheres, std::size_t begin, std::size_t end, const std::uint32_t* list,
                  std::size_t list_begin, const std::size_t* list_end, bool one_radius, PartnerSum* out) {
    (one_radius ? sum_one_radius : sum_many_radii)(spheres, begin, end, list, list_begin, list_end, out);
}

} // namespace talus::packing
