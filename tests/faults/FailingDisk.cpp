// A library to be preloaded (LD_PRELOAD) into a program whose disk is to fail, or which is to be killed, at its n-th
// operation that changes something below a folder.  attacks.py arms it.  Programs that write through stdio are not
// seen: glibc does not call itself by name.
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <dlfcn.h>
#include <fcntl.h>
#include <string>
#include <sys/sendfile.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

namespace {

enum Mode {
    Watch, // nothing happens
    Fail,  // the operation fails with EIO, once
    Full,  // the write is done in part, and from then on nothing that takes room is possible: ENOSPC
    Kill,  // the program is killed before the operation
    Torn,  // the write is done in part, and the program is killed
    Short  // the write is done in part, once, as it may be where a disk is full and has room again
};
enum Needs { Nothing, Room };

Mode mode = Watch;
long target = 0;
std::atomic<long> count{0};
std::string folder;
int journal = -1;

template <class F>
F* next(F*, const char* name) {
    return reinterpret_cast<F*>(dlsym(RTLD_NEXT, name));
}
#define NEXT(function) static const auto next##function = next(&function, #function)

bool isWatched(const std::string& path) {
    return journal >= 0 && path.compare(0, folder.size(), folder) == 0 &&
           (path.size() == folder.size() || path[folder.size()] == '/');
}

std::string pathOf(const char* path) {
    char here[4096];
    return path[0] == '/' || !getcwd(here, sizeof here) ? path : std::string(here) + '/' + path;
}

std::string pathOf(int descriptor) {
    char path[4096];
    ssize_t length = readlink(("/proc/self/fd/" + std::to_string(descriptor)).c_str(), path, sizeof path);
    return length > 0 ? std::string(path, length) : "";
}

[[noreturn]] void die() {
    kill(getpid(), SIGKILL);
    for (;;)
        pause();
}

// What becomes of an operation.
enum Fate { Passes, Fails, IsHalved };

Fate fateOf(const char* name, const std::string& path, Needs needs, size_t size = 0) {
    bool isOfWrites = mode == Torn || mode == Short;
    if (!isWatched(path) || (mode == Full && needs != Room) || (isOfWrites && size < 2))
        return Passes;
    long n = ++count;
    if (mode == Watch || n == target)
        dprintf(journal, "%s %s\n", name, path.size() > folder.size() ? path.c_str() + folder.size() + 1 : ".");
    if (mode == Watch || n < target || (n > target && mode != Full))
        return Passes;
    if (mode == Kill)
        die();
    if (size > 1 && n == target && mode != Fail)
        return IsHalved;
    errno = mode == Full ? ENOSPC : EIO;
    return Fails;
}

// A write, which `write(size)` does up to a size.
template <class W>
ssize_t writeAs(const char* name, int descriptor, size_t size, W write) {
    int before = errno;
    Fate fate = fateOf(name, pathOf(descriptor), Room, size);
    if (fate == Fails)
        return -1;
    errno = before;
    if (fate == Passes)
        return write(size);
    ssize_t written = write(size / 2);
    if (mode == Torn)
        die();
    return written;
}

template <class O>
int doAs(const char* name, const std::string& path, Needs needs, O operation) {
    int before = errno;
    if (fateOf(name, path, needs) == Fails)
        return -1;
    errno = before;
    return operation();
}

bool changes(int flags) {
    return (flags & O_ACCMODE) != O_RDONLY;
}

template <class O>
int openAs(const char* path, int flags, O operation) {
    return changes(flags) ? doAs("open", pathOf(path), flags & O_CREAT ? Room : Nothing, operation) : operation();
}

} // namespace

extern "C" {

// Arm the library; what strikes, or in the mode Watch every operation, is written to a file.
void attack(const char* below, int how, long n, int file) {
    folder = below;
    mode = static_cast<Mode>(how);
    target = n;
    count = 0;
    journal = file;
}

// The rights for a new file, if there may be one, are the last of variable arguments.
#define RIGHTS                                                                                                         \
    va_list arguments;                                                                                                 \
    va_start(arguments, flags);                                                                                        \
    mode_t rights = flags & (O_CREAT | O_TMPFILE) ? va_arg(arguments, mode_t) : 0;                                     \
    va_end(arguments)

#define OPENS(function)                                                                                                \
    int function(const char* path, int flags, ...) {                                                                   \
        NEXT(function);                                                                                                \
        RIGHTS;                                                                                                        \
        return openAs(path, flags, [&] { return next##function(path, flags, rights); });                               \
    }
OPENS(open)
OPENS(open64)

#define OPENS_AT(function)                                                                                             \
    int function(int place, const char* path, int flags, ...) {                                                        \
        NEXT(function);                                                                                                \
        RIGHTS;                                                                                                        \
        return openAs(path, flags, [&] { return next##function(place, path, flags, rights); });                        \
    }
OPENS_AT(openat)
OPENS_AT(openat64)

int close(int descriptor) {
    NEXT(close);
    std::string path = journal >= 0 ? pathOf(descriptor) : "";
    if (!isWatched(path) || !changes(fcntl(descriptor, F_GETFL)))
        return nextclose(descriptor);
    if (doAs("close", path, Nothing, [] { return 0; }) == 0)
        return nextclose(descriptor);
    nextclose(descriptor); // Linux closes it in any case
    errno = EIO;
    return -1;
}

ssize_t write(int descriptor, const void* data, size_t size) {
    NEXT(write);
    return writeAs("write", descriptor, size, [&](size_t n) { return nextwrite(descriptor, data, n); });
}

#define WRITES_AT(function, Offset)                                                                                    \
    ssize_t function(int descriptor, const void* data, size_t size, Offset place) {                                    \
        NEXT(function);                                                                                                \
        return writeAs("write", descriptor, size,                                                                      \
                       [&](size_t n) { return next##function(descriptor, data, n, place); });                          \
    }
WRITES_AT(pwrite, off_t)
WRITES_AT(pwrite64, off64_t)

ssize_t writev(int descriptor, const iovec* parts, int numParts) {
    NEXT(writev);
    size_t size = 0;
    for (int i = 0; i < numParts; i++)
        size += parts[i].iov_len;
    return writeAs("write", descriptor, size, [&](size_t n) {
        // Of what is halved the first part alone is written, which can be empty.
        return n == size ? nextwritev(descriptor, parts, numParts) : nextwritev(descriptor, parts, 1);
    });
}

#define SENDS(function, Offset)                                                                                        \
    ssize_t function(int to, int from, Offset* place, size_t size) {                                                   \
        NEXT(function);                                                                                                \
        return writeAs("write", to, size, [&](size_t n) { return next##function(to, from, place, n); });               \
    }
SENDS(sendfile, off_t)
SENDS(sendfile64, off64_t)

ssize_t copy_file_range(int from, off64_t* start, int to, off64_t* place, size_t size, unsigned flags) {
    NEXT(copy_file_range);
    return writeAs("write", to, size, [&](size_t n) { return nextcopy_file_range(from, start, to, place, n, flags); });
}

#define OF_DESCRIPTOR(function, needs)                                                                                 \
    int function(int descriptor) {                                                                                     \
        NEXT(function);                                                                                                \
        return doAs(#function, pathOf(descriptor), needs, [&] { return next##function(descriptor); });                 \
    }
OF_DESCRIPTOR(fsync, Nothing)
OF_DESCRIPTOR(fdatasync, Nothing)

#define TRUNCATES(function, Offset)                                                                                    \
    int function(int descriptor, Offset size) {                                                                        \
        NEXT(function);                                                                                                \
        return doAs("truncate", pathOf(descriptor), Nothing, [&] { return next##function(descriptor, size); });        \
    }
TRUNCATES(ftruncate, off_t)
TRUNCATES(ftruncate64, off64_t)

#define TRUNCATES_PATH(function, Offset)                                                                               \
    int function(const char* path, Offset size) {                                                                      \
        NEXT(function);                                                                                                \
        return doAs("truncate", pathOf(path), Nothing, [&] { return next##function(path, size); });                    \
    }
TRUNCATES_PATH(truncate, off_t)
TRUNCATES_PATH(truncate64, off64_t)

int rename(const char* from, const char* to) {
    NEXT(rename);
    return doAs("rename", pathOf(to), Nothing, [&] { return nextrename(from, to); });
}

int renameat(int fromPlace, const char* from, int toPlace, const char* to) {
    NEXT(renameat);
    return doAs("rename", pathOf(to), Nothing, [&] { return nextrenameat(fromPlace, from, toPlace, to); });
}

int link(const char* from, const char* to) {
    NEXT(link);
    return doAs("link", pathOf(to), Room, [&] { return nextlink(from, to); });
}

int linkat(int fromPlace, const char* from, int toPlace, const char* to, int flags) {
    NEXT(linkat);
    return doAs("link", pathOf(to), Room, [&] { return nextlinkat(fromPlace, from, toPlace, to, flags); });
}

int unlink(const char* path) {
    NEXT(unlink);
    return doAs("unlink", pathOf(path), Nothing, [&] { return nextunlink(path); });
}

int unlinkat(int place, const char* path, int flags) {
    NEXT(unlinkat);
    return doAs("unlink", pathOf(path), Nothing, [&] { return nextunlinkat(place, path, flags); });
}

int mkdir(const char* path, mode_t rights) {
    NEXT(mkdir);
    return doAs("mkdir", pathOf(path), Room, [&] { return nextmkdir(path, rights); });
}

} // extern "C"
