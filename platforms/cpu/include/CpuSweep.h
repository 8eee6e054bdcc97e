#ifndef OPENMM_CPUSWEEP_H_
#define OPENMM_CPUSWEEP_H_

#include "CpuThreads.h"
#include "openmmhelfrich/internal/HelfrichMesh.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include "openmmhelfrich/internal/Philox.h"
#include <algorithm>
#include <functional>

namespace HelfrichPlugin {

/**
 * What Metropolis sweeps over a membrane whose vertices do not move have in common.
 *
 * A sweep is by definition a sequential chain: attempt follows attempt, and attempt n of sweep s takes its random
 * numbers from the counter (s, n).  How threads share it does not change a bit of the outcome.
 */
class CpuSweep {
public:
    /**
     * This is called for each accepted attempt, in their order, with the change of energy by which it was accepted.
     */
    typedef std::function<void(double)> Observer;
protected:
    /// there is no more work for threads than for so many
    static constexpr int MAX_THREADS = 8;
    /**
     * @param mesh               the membrane, which sweeps change
     * @param numThreads         the most threads to use
     * @param verticesPerThread  the number of vertices that makes another thread worth while
     */
    CpuSweep(HelfrichMesh& mesh, int numThreads, int verticesPerThread)
            : mesh(mesh),
              numThreads(std::max(1, std::min({numThreads, MAX_THREADS, mesh.getNumVertices() / verticesPerThread}))),
              random(0, 0) {
    }
    /**
     * Call a function with the beginning and the end of each part of the vertices, on all threads.
     */
    template <class Function>
    void forEachPart(const Function& function) const {
        CpuThreads::forEachPart(numThreads, mesh.getNumVertices(), VERTICES_PER_PART, function);
    }
    /**
     * Call a function with each vertex, on all threads.
     */
    template <class Function>
    void forEachVertex(const Function& function) const {
        forEachPart([&](int begin, int end) {
            for (int v = begin; v < end; v++)
                function(v);
        });
    }
    /**
     * Set what the attempts of a sweep depend on besides the membrane.
     */
    void begin(double kT, long long numAttempts, const Philox& random, long long sweep) {
        this->kT = kT;
        this->numAttempts = numAttempts;
        this->random = random;
        this->sweep = sweep;
    }
    static constexpr int NONE = -1;
    HelfrichMesh& mesh;
    const int numThreads;
    HelfrichParameters p;
    double kT;
    long long numAttempts, sweep;
    Philox random;
private:
    static constexpr int VERTICES_PER_PART = 256;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUSWEEP_H_*/
