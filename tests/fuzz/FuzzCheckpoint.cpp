/* Checkpoints of integrators with some of their bytes changed, or without their end.  Positions and the rest of a
 * Context's checkpoint are OpenMM's own to read. */

#include "Fuzzing.h"
#include <cstring>
#include <sstream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static void editBytes(FuzzedDataProvider& data, string& bytes) {
    int numEdits = data.ConsumeIntegralInRange(0, 4);
    for (int i = 0; i < numEdits && bytes.size() > 8; i++) {
        size_t position = data.ConsumeIntegralInRange<size_t>(0, bytes.size() - 8);
        switch (data.ConsumeIntegralInRange(0, 4)) {
            case 0:
                bytes[position] = data.ConsumeIntegral<char>();
                break;
            case 1: {
                int value = data.ConsumeIntegral<int>();
                memcpy(&bytes[position / 4 * 4], &value, 4);
                break;
            }
            case 2: {
                int value = data.ConsumeIntegralInRange(-1, 24);
                memcpy(&bytes[position / 4 * 4], &value, 4);
                break;
            }
            case 3:
                bytes.resize(position);
                break;
            default:
                bytes.insert(position, data.ConsumeRandomLengthString(16));
        }
    }
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
    FuzzedDataProvider data(bytes, size);
    static const Membrane blob = createBlob(1), octahedron = createBlob(0);
    const Membrane& membrane = data.ConsumeBool() ? blob : octahedron;
    System system;
    fillSystem(system, membrane.positions.size(), {createForce(membrane, createParameters(membrane, EveryTerm, 1))});
    OpenIntegrator integrator;
    Context context(system, integrator, *getPlatforms()[data.ConsumeIntegralInRange(0, 1)]);
    context.setPositions(membrane.positions);
    integrator.step(2);
    stringstream written;
    integrator.createCheckpoint(written);
    string checkpoint = written.str();
    editBytes(data, checkpoint);
    stringstream read(checkpoint);
    try {
        integrator.loadCheckpoint(read);
    }
    catch (const OpenMMException&) {
        // Whatever was taken from it before the error: the simulation is one that can go on.
    }
    require(isComputable(context), "a simulation after a damaged checkpoint");
    integrator.step(2);
    return 0;
}
