#ifndef OPENMM_CPUMEMORY_H_
#define OPENMM_CPUMEMORY_H_

#include <cstddef>
#include <new>

namespace HelfrichPlugin {

/**
 * An allocator of memory on cache lines.
 */
template <class T>
struct CacheLineAllocator {
    typedef T value_type;
    CacheLineAllocator() = default;
    template <class U>
    CacheLineAllocator(const CacheLineAllocator<U>&) {
    }
    T* allocate(size_t n) {
        return static_cast<T*>(::operator new(n * sizeof(T), std::align_val_t(64)));
    }
    void deallocate(T* data, size_t) {
        ::operator delete(data, std::align_val_t(64));
    }
    bool operator==(const CacheLineAllocator&) const {
        return true;
    }
    bool operator!=(const CacheLineAllocator&) const {
        return false;
    }
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUMEMORY_H_*/
