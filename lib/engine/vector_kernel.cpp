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

struct InDouble {
    template <class F, bool OneSize, bool Materials>
    PairKernel operator()() const {
        return vector_pairs<F, OneSize, Materials>;
    }
};

PairKernel choose_vector_kernel(const KernelTraits& traits) {
    return by_traits(traits, InDouble{});
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
