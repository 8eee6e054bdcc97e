#ifndef OPENMM_CPURELAXED_H_
#define OPENMM_CPURELAXED_H_

namespace HelfrichPlugin {

/**
 * Numbers that one thread may change while others read them: these get a value that a number had or has, and nothing
 * else follows.
 *
 * These are relaxed atomic operations.  Compilers take those for barriers to their optimization, which costs a tenth of
 * a sweep of flips, and so the numbers are volatile: processors read and write them at once, for they are aligned and
 * have no more than 8 bytes.  The sanitizer of data races gets to see the atomic ones.  (A function that does nothing
 * but read plain numbers and prefetch would have no effect in GCC's opinion, and not be called.)
 */
struct RelaxedAccess {
    template <class T>
    static T get(const T& number) {
#ifdef HELFRICH_THREAD_SANITIZER
        T result;
        __atomic_load(&number, &result, __ATOMIC_RELAXED);
        return result;
#else
        return const_cast<const volatile T&>(number);
#endif
    }
    template <class T>
    static void set(T& number, T value) {
#ifdef HELFRICH_THREAD_SANITIZER
        __atomic_store(&number, &value, __ATOMIC_RELAXED);
#else
        const_cast<volatile T&>(number) = value;
#endif
    }
};

/**
 * A number that is always accessed in this way, and can be copied.
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
    Relaxed& operator=(T other) {
        RelaxedAccess::set(value, other);
        return *this;
    }
    Relaxed& operator+=(T difference) {
        return *this = T(*this) + difference;
    }
    operator T() const {
        return RelaxedAccess::get(value);
    }
private:
    T value;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPURELAXED_H_*/
