// SPDX-License-Identifier: GPL-3.0-or-later
/// Vector code shared by kernels: records of four doubles, and eight (four, two) records at a time turned
/// into one vector per component. Compiled once per instruction set: a kernel's file includes
/// hwy/foreach_target.h and then this.
#if defined(TALUS_BASE_SIMD_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef TALUS_BASE_SIMD_INL
#undef TALUS_BASE_SIMD_INL
#else
#define TALUS_BASE_SIMD_INL
#endif

#include <array>
#include <cstddef>
#include <cstdint>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace talus {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<double, 8>; ///< as many doubles as the processor holds, at most eight
using I = hn::RebindToSigned<D>;
using V = hn::Vec<D>;
using M = hn::Mask<D>;
constexpr std::size_t lanes = hn::MaxLanes(D{});

// ---- Quad: one record of four doubles (x, y, z, w), in one or two registers.
#if HWY_MAX_BYTES >= 32
using Q = hn::FixedTag<double, 4>;
struct Quad {
    hn::Vec<Q> v;
};
HWY_INLINE Quad load_quad(const double* from) {
    return {hn::Load(Q{}, from)};
}
HWY_INLINE Quad load_quad(const float* from) {
    return {hn::PromoteTo(Q{}, hn::Load(hn::Rebind<float, Q>{}, from))};
}
HWY_INLINE void store_quad(const Quad& a, double* to) {
    hn::Store(a.v, Q{}, to);
}
HWY_INLINE void store_quad(const Quad& a, float* to) {
    hn::Store(hn::DemoteTo(hn::Rebind<float, Q>{}, a.v), hn::Rebind<float, Q>{}, to);
}
HWY_INLINE Quad quad(double s) {
    return {hn::Set(Q{}, s)};
}
HWY_INLINE Quad operator+(const Quad& a, const Quad& b) {
    return {hn::Add(a.v, b.v)};
}
HWY_INLINE Quad operator-(const Quad& a, const Quad& b) {
    return {hn::Sub(a.v, b.v)};
}
HWY_INLINE Quad operator*(const Quad& a, const Quad& b) {
    return {hn::Mul(a.v, b.v)};
}
HWY_INLINE Quad operator^(const Quad& a, const Quad& b) {
    return {hn::Xor(a.v, b.v)};
}
HWY_INLINE Quad max(const Quad& a, const Quad& b) {
    return {hn::Max(a.v, b.v)};
}
HWY_INLINE Quad abs(const Quad& a) {
    return {hn::Abs(a.v)};
}
/// x, y, z of `a` with w of `b`.
HWY_INLINE Quad with_w(const Quad& a, const Quad& b) {
    return {hn::IfThenElse(hn::FirstN(Q{}, 3), a.v, b.v)};
}
#else
using H = hn::FixedTag<double, 2>;
struct Quad {
    hn::Vec<H> lo, hi;
};
HWY_INLINE Quad load_quad(const double* from) {
    return {hn::Load(H{}, from), hn::Load(H{}, from + 2)};
}
HWY_INLINE Quad load_quad(const float* from) {
    const hn::Rebind<float, H> f;
    return {hn::PromoteTo(H{}, hn::LoadU(f, from)), hn::PromoteTo(H{}, hn::LoadU(f, from + 2))};
}
HWY_INLINE void store_quad(const Quad& a, double* to) {
    hn::Store(a.lo, H{}, to);
    hn::Store(a.hi, H{}, to + 2);
}
HWY_INLINE void store_quad(const Quad& a, float* to) {
    const hn::Rebind<float, H> f;
    hn::StoreU(hn::DemoteTo(f, a.lo), f, to);
    hn::StoreU(hn::DemoteTo(f, a.hi), f, to + 2);
}
HWY_INLINE Quad quad(double s) {
    return {hn::Set(H{}, s), hn::Set(H{}, s)};
}
HWY_INLINE Quad operator+(const Quad& a, const Quad& b) {
    return {hn::Add(a.lo, b.lo), hn::Add(a.hi, b.hi)};
}
HWY_INLINE Quad operator-(const Quad& a, const Quad& b) {
    return {hn::Sub(a.lo, b.lo), hn::Sub(a.hi, b.hi)};
}
HWY_INLINE Quad operator*(const Quad& a, const Quad& b) {
    return {hn::Mul(a.lo, b.lo), hn::Mul(a.hi, b.hi)};
}
HWY_INLINE Quad operator^(const Quad& a, const Quad& b) {
    return {hn::Xor(a.lo, b.lo), hn::Xor(a.hi, b.hi)};
}
HWY_INLINE Quad max(const Quad& a, const Quad& b) {
    return {hn::Max(a.lo, b.lo), hn::Max(a.hi, b.hi)};
}
HWY_INLINE Quad abs(const Quad& a) {
    return {hn::Abs(a.lo), hn::Abs(a.hi)};
}
HWY_INLINE Quad with_w(const Quad& a, const Quad& b) {
    return {a.lo, hn::ConcatUpperLower(H{}, b.hi, a.hi)};
}
#endif

using R = hn::Rebind<float, D>; ///< as many floats as there are doubles in a vector
using T = hn::Vec<R>;
using U64 = hn::RebindToUnsigned<D>;
using U32 = hn::Rebind<std::uint32_t, D>;

// ---- Oct: a record of eight floats, in one or two registers.
#if HWY_MAX_BYTES >= 32
using O = hn::FixedTag<float, 8>;
struct Oct {
    hn::Vec<O> v;
};
HWY_INLINE Oct load_oct(const float* from) {
    return {hn::Load(O{}, from)};
}
HWY_INLINE Oct oct(float s) {
    return {hn::Set(O{}, s)};
}
HWY_INLINE Oct operator+(const Oct& a, const Oct& b) {
    return {hn::Add(a.v, b.v)};
}
HWY_INLINE Oct operator*(const Oct& a, const Oct& b) {
    return {hn::Mul(a.v, b.v)};
}
HWY_INLINE Oct operator^(const Oct& a, const Oct& b) {
    return {hn::Xor(a.v, b.v)};
}
HWY_INLINE Oct max(const Oct& a, const Oct& b) {
    return {hn::Max(a.v, b.v)};
}
/// Bits of `b` where `mask` has ones, else of `a`.
HWY_INLINE Oct blend(const Oct& mask, const Oct& b, const Oct& a) {
    return {hn::Or(hn::And(mask.v, b.v), hn::AndNot(mask.v, a.v))};
}
HWY_INLINE Quad as_quad(const Oct& a) {
    return {hn::BitCast(Q{}, a.v)};
}
#else
using O = hn::FixedTag<float, 4>;
struct Oct {
    hn::Vec<O> lo, hi;
};
HWY_INLINE Oct load_oct(const float* from) {
    return {hn::Load(O{}, from), hn::Load(O{}, from + 4)};
}
HWY_INLINE Oct oct(float s) {
    return {hn::Set(O{}, s), hn::Set(O{}, s)};
}
HWY_INLINE Oct operator+(const Oct& a, const Oct& b) {
    return {hn::Add(a.lo, b.lo), hn::Add(a.hi, b.hi)};
}
HWY_INLINE Oct operator*(const Oct& a, const Oct& b) {
    return {hn::Mul(a.lo, b.lo), hn::Mul(a.hi, b.hi)};
}
HWY_INLINE Oct operator^(const Oct& a, const Oct& b) {
    return {hn::Xor(a.lo, b.lo), hn::Xor(a.hi, b.hi)};
}
HWY_INLINE Oct max(const Oct& a, const Oct& b) {
    return {hn::Max(a.lo, b.lo), hn::Max(a.hi, b.hi)};
}
HWY_INLINE Oct blend(const Oct& mask, const Oct& b, const Oct& a) {
    return {hn::Or(hn::And(mask.lo, b.lo), hn::AndNot(mask.lo, a.lo)),
            hn::Or(hn::And(mask.hi, b.hi), hn::AndNot(mask.hi, a.hi))};
}
HWY_INLINE Quad as_quad(const Oct& a) {
    return {hn::BitCast(H{}, a.lo), hn::BitCast(H{}, a.hi)};
}
#endif

/// Flips the signs of x, y and z (xor).
HWY_INLINE Quad signs_of_xyz() {
    alignas(32) static constexpr double signs[4] = {-0.0, -0.0, -0.0, 0.0};
    return load_quad(signs);
}
/// Flips the signs of the first three floats (xor).
HWY_INLINE Oct signs_of_first_three() {
    alignas(32) static constexpr float signs[8] = {-0.0f, -0.0f, -0.0f, 0, 0, 0, 0, 0};
    return load_oct(signs);
}
/// Ones in the fourth float.
HWY_INLINE Oct mask_of_fourth() {
    alignas(32) static constexpr std::uint32_t fourth[8] = {0, 0, 0, ~0u, 0, 0, 0, 0};
    return load_oct(reinterpret_cast<const float*>(fourth));
}
/// One component of `lanes` records each.
struct Components {
    V x, y, z, w;
};

/// Turns `lanes` records into vectors of their components: record k goes to lane k.
HWY_INLINE Components components(const std::array<Quad, lanes>& r) {
    const D d;
#if HWY_MAX_BYTES >= 64
    const V a0 = hn::Combine(d, r[4].v, r[0].v), a1 = hn::Combine(d, r[5].v, r[1].v),
            a2 = hn::Combine(d, r[6].v, r[2].v), a3 = hn::Combine(d, r[7].v, r[3].v);
#elif HWY_MAX_BYTES >= 32
    const V a0 = r[0].v, a1 = r[1].v, a2 = r[2].v, a3 = r[3].v;
#endif
#if HWY_MAX_BYTES >= 32
    const V xz01 = hn::InterleaveLower(d, a0, a1), yw01 = hn::InterleaveUpper(d, a0, a1);
    const V xz23 = hn::InterleaveLower(d, a2, a3), yw23 = hn::InterleaveUpper(d, a2, a3);
    return {hn::OddEvenBlocks(hn::SwapAdjacentBlocks(xz23), xz01),
            hn::OddEvenBlocks(hn::SwapAdjacentBlocks(yw23), yw01),
            hn::OddEvenBlocks(xz23, hn::SwapAdjacentBlocks(xz01)),
            hn::OddEvenBlocks(yw23, hn::SwapAdjacentBlocks(yw01))};
#else
    return {hn::InterleaveLower(d, r[0].lo, r[1].lo), hn::InterleaveUpper(d, r[0].lo, r[1].lo),
            hn::InterleaveLower(d, r[0].hi, r[1].hi), hn::InterleaveUpper(d, r[0].hi, r[1].hi)};
#endif
}

/// Eight components of `lanes` records of floats.
struct Octets {
    T a, b, c, d, e, f, g, h;
};

HWY_INLINE T even_floats(const V& v) {
    return hn::BitCast(R{}, hn::TruncateTo(U32{}, hn::BitCast(U64{}, v)));
}
HWY_INLINE T odd_floats(const V& v) {
    return hn::BitCast(R{}, hn::TruncateTo(U32{}, hn::ShiftRight<32>(hn::BitCast(U64{}, v))));
}
HWY_INLINE Octets octets(const std::array<Quad, lanes>& records) {
    const Components c = components(records);
    return {even_floats(c.x), odd_floats(c.x), even_floats(c.y), odd_floats(c.y),
            even_floats(c.z), odd_floats(c.z), even_floats(c.w), odd_floats(c.w)};
}
#if HWY_MAX_BYTES >= 32
/// Components back as records: entry k holds record k, and record k + 4 in its upper half where there is one.
HWY_INLINE std::array<V, 4> records(const Components& c) {
    const D d;
    const V xy_even = hn::InterleaveLower(d, c.x, c.y), xy_odd = hn::InterleaveUpper(d, c.x, c.y);
    const V zw_even = hn::InterleaveLower(d, c.z, c.w), zw_odd = hn::InterleaveUpper(d, c.z, c.w);
    return {hn::OddEvenBlocks(hn::SwapAdjacentBlocks(zw_even), xy_even),
            hn::OddEvenBlocks(hn::SwapAdjacentBlocks(zw_odd), xy_odd),
            hn::OddEvenBlocks(zw_even, hn::SwapAdjacentBlocks(xy_even)),
            hn::OddEvenBlocks(zw_odd, hn::SwapAdjacentBlocks(xy_odd))};
}
#endif

/// Turns components back into records, record k to to[k * stride].
HWY_INLINE void store_records(const Components& c, double* to, std::size_t stride) {
#if HWY_MAX_BYTES >= 64
    const std::array<V, 4> r = records(c);
    for (std::size_t k = 0; k < 4; ++k) {
        hn::Store(hn::LowerHalf(Q{}, r[k]), Q{}, to + k * stride);
        hn::Store(hn::UpperHalf(Q{}, r[k]), Q{}, to + (k + 4) * stride);
    }
#elif HWY_MAX_BYTES >= 32
    const std::array<V, 4> r = records(c);
    for (std::size_t k = 0; k < 4; ++k)
        hn::Store(r[k], Q{}, to + k * stride);
#else
    const D d;
    hn::Store(hn::InterleaveLower(d, c.x, c.y), d, to);
    hn::Store(hn::InterleaveLower(d, c.z, c.w), d, to + 2);
    hn::Store(hn::InterleaveUpper(d, c.x, c.y), d, to + stride);
    hn::Store(hn::InterleaveUpper(d, c.z, c.w), d, to + stride + 2);
#endif
}

/// Two records side by side, 8 doubles in all, those of lane k to to[8 k].
HWY_INLINE void store_double_records(const Components& a, const Components& b, double* to) {
#if HWY_MAX_BYTES >= 64
    const D d;
    const std::array<V, 4> left = records(a), right = records(b);
    for (std::size_t k = 0; k < 4; ++k) {
        hn::Store(hn::ConcatLowerLower(d, right[k], left[k]), d, to + 8 * k);
        hn::Store(hn::ConcatUpperUpper(d, right[k], left[k]), d, to + 8 * (k + 4));
    }
#else
    store_records(a, to, 8);
    store_records(b, to + 4, 8);
#endif
}

/// Bits of the lanes of a mask, lane 0 lowest.
HWY_INLINE unsigned bits_of(const M& mask) {
    alignas(8) std::uint8_t bytes[8] = {};
    hn::StoreMaskBits(D{}, mask, bytes);
    return bytes[0];
}
HWY_INLINE M mask_of(unsigned bits) {
    alignas(8) const std::uint8_t bytes[8] = {static_cast<std::uint8_t>(bits)};
    return hn::LoadMaskBits(D{}, bytes);
}

/// Vectors in space, one per lane.
template <class T>
struct Three {
    T x, y, z;
};
HWY_INLINE Three<V> doubles(const T& x, const T& y, const T& z) {
    const D d;
    return {hn::PromoteTo(d, x), hn::PromoteTo(d, y), hn::PromoteTo(d, z)};
}
template <class T>
HWY_INLINE Three<T> operator+(const Three<T>& a, const Three<T>& b) {
    return {hn::Add(a.x, b.x), hn::Add(a.y, b.y), hn::Add(a.z, b.z)};
}
template <class T>
HWY_INLINE Three<T> operator-(const Three<T>& a, const Three<T>& b) {
    return {hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z)};
}
template <class T>
HWY_INLINE Three<T> operator*(const T& s, const Three<T>& a) {
    return {hn::Mul(s, a.x), hn::Mul(s, a.y), hn::Mul(s, a.z)};
}
/// b + s a.
template <class T>
HWY_INLINE Three<T> add_scaled(const Three<T>& b, const T& s, const Three<T>& a) {
    return {hn::MulAdd(s, a.x, b.x), hn::MulAdd(s, a.y, b.y), hn::MulAdd(s, a.z, b.z)};
}
/// b - s a.
template <class T>
HWY_INLINE Three<T> take_scaled(const Three<T>& b, const T& s, const Three<T>& a) {
    return {hn::NegMulAdd(s, a.x, b.x), hn::NegMulAdd(s, a.y, b.y), hn::NegMulAdd(s, a.z, b.z)};
}
template <class T>
HWY_INLINE T dot(const Three<T>& a, const Three<T>& b) {
    return hn::MulAdd(a.z, b.z, hn::MulAdd(a.y, b.y, hn::Mul(a.x, b.x)));
}
template <class T>
HWY_INLINE Three<T> cross(const Three<T>& a, const Three<T>& b) {
    return {hn::MulSub(a.y, b.z, hn::Mul(a.z, b.y)), hn::MulSub(a.z, b.x, hn::Mul(a.x, b.z)),
            hn::MulSub(a.x, b.y, hn::Mul(a.y, b.x))};
}
template <class Mask, class T>
HWY_INLINE Three<T> choose(const Mask& mask, const Three<T>& yes, const Three<T>& no) {
    return {hn::IfThenElse(mask, yes.x, no.x), hn::IfThenElse(mask, yes.y, no.y),
            hn::IfThenElse(mask, yes.z, no.z)};
}
template <class Mask, class T>
HWY_INLINE Three<T> keep(const Mask& mask, const Three<T>& a) {
    return {hn::IfThenElseZero(mask, a.x), hn::IfThenElseZero(mask, a.y), hn::IfThenElseZero(mask, a.z)};
}

} // namespace HWY_NAMESPACE
} // namespace talus
HWY_AFTER_NAMESPACE();

#endif
