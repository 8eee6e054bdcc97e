#ifndef OPENMM_HELFRICHRELAXED_H_
#define OPENMM_HELFRICHRELAXED_H_

namespace HelfrichPlugin {

/**
 * A number that one thread may change while others read it: these get a value that it had or has, and nothing else
 * follows.
 *
 * This is a relaxed std::atomic that can be copied.  Compilers take those for barriers to their optimization, which
 * costs a tenth of a sweep of flips, and so the number is volatile: processors read and write it at once, for it is
 * aligned and has no more than 8 bytes.  The sanitizer of data races gets to see the atomic.  (A function that does
 * nothing but read plain numbers and prefetch would have no effect in GCC's opinion, and not be called.)
 */
template <class T>
class Relaxed {
public:
    Relaxed(T value = T()) : value(value) {
    }
    Relaxed(const Relaxed& other) : value(T(other)) {
    }
    Relaxed& operator=(const Relaxed& other) {
        return *this = T(other);
    }
    Relaxed& operator+=(T difference) {
        return *this = T(*this) + difference;
    }
#ifdef HELFRICH_THREAD_SANITIZER
    Relaxed& operator=(T other) {
        __atomic_store(&value, &other, __ATOMIC_RELAXED);
        return *this;
    }
    operator T() const {
        T result;
        __atomic_load(&value, &result, __ATOMIC_RELAXED);
        return result;
    }
private:
    T value;
#else
    Relaxed& operator=(T other) {
        value = other;
        return *this;
    }
    operator T() const {
        return value;
    }
private:
    volatile T value;
#endif
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHRELAXED_H_*/
