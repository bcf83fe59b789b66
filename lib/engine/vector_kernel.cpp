// SPDX-License-Identifier: GPL-3.0-or-later
/// All instantiations of the vector pair loop in double precision, once per instruction set.
#include "engine/vector_kernel.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/vector_kernel.cpp"
#include <hwy/foreach_target.h>

#include "engine/vector_kernel-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace talus::engine {
namespace HWY_NAMESPACE {

template <class F>
PairKernel by_sizes(const KernelTraits& t) {
    if (t.materials)
        return vector_pairs<F, false, true>;
    return t.one_size ? vector_pairs<F, true, false> : vector_pairs<F, false, false>;
}

PairKernel choose_vector_kernel(const KernelTraits& t) {
    using contact::Features;
    if (t.linear)
        return t.tangential ? (t.offsets ? by_sizes<Features<true, false, true, true>>(t)
                                         : by_sizes<Features<true, false, false, true>>(t))
                            : (t.offsets ? by_sizes<Features<false, false, true, true>>(t)
                                         : by_sizes<Features<false, false, false, true>>(t));
    if (t.bonds)
        return t.offsets ? by_sizes<Features<true, true, true>>(t) : by_sizes<Features<true, true, false>>(t);
    if (t.tangential)
        return t.offsets ? by_sizes<Features<true, false, true>>(t) : by_sizes<Features<true, false, false>>(t);
    return t.offsets ? by_sizes<Features<false, false, true>>(t) : by_sizes<Features<false, false, false>>(t);
}

} // namespace HWY_NAMESPACE
} // namespace talus::engine
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace talus::engine {

HWY_EXPORT(choose_vector_kernel);

PairKernel vector_kernel(const KernelTraits& traits) {
    return HWY_DYNAMIC_DISPATCH(choose_vector_kernel)(traits);
}

} // namespace talus::engine
#endif
