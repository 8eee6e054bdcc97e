/* Positions and parameters of any size: on both platforms the energy and the forces are finite, or there is an error
 * that says so, and no move changes that. */

#include "Fuzzing.h"
#include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"
#include "openmmhelfrich/HybridMonteCarloIntegrator.h"
#include <memory>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * A number from the least to the greatest power of 2 that there is: most doubles, drawn bit by bit, are neither near 1
 * nor near each other.
 */
static double drawNumber(FuzzedDataProvider& data) {
    int kind = data.ConsumeIntegralInRange(0, 5);
    if (kind == 0)
        return data.ConsumeFloatingPoint<double>();
    if (kind == 1)
        return 0;
    return ldexp(data.ConsumeIntegral<int8_t>() / 64.0,
                 kind == 2 ? data.ConsumeIntegralInRange(-1080, 1023) : data.ConsumeIntegralInRange(-40, 10));
}

static void editPositions(FuzzedDataProvider& data, vector<Vec3>& positions) {
    int numEdits = data.ConsumeIntegralInRange(0, 12);
    double scale = data.ConsumeBool() ? fabs(drawNumber(data)) : 1;
    for (auto& x : positions)
        x *= scale;
    for (int i = 0; i < numEdits; i++) {
        Vec3& x = positions[data.ConsumeIntegralInRange<size_t>(0, positions.size() - 1)];
        int axis = data.ConsumeIntegralInRange(0, 2);
        const Vec3& other = positions[data.ConsumeIntegralInRange<size_t>(0, positions.size() - 1)];
        switch (data.ConsumeIntegralInRange(0, 3)) {
            case 0:
                x[axis] = drawNumber(data);
                break;
            case 1:
                x[axis] += drawNumber(data);
                break;
            case 2:
                x = other;
                break;
            default:
                x[axis] = other[axis];
        }
    }
}

static HelfrichForce* createFuzzedForce(FuzzedDataProvider& data, const Membrane& membrane) {
    HelfrichParameters p = createParameters(membrane, getTermsOfBits(data.ConsumeIntegral<uint8_t>()),
                                            data.ConsumeIntegralInRange(0, 2));
    unique_ptr<HelfrichForce> force(createForce(membrane, p));
    if (data.ConsumeBool()) {
        force->setBendingModulus(fabs(drawNumber(data)));
        force->setTargetVolume(fabs(drawNumber(data)));
        force->setTargetAreaDifference(drawNumber(data));
        force->setTether(fabs(drawNumber(data)), fabs(drawNumber(data)), fabs(drawNumber(data)),
                         data.ConsumeIntegralInRange(0, 20));
        force->setTension(drawNumber(data));
        force->setPressure(drawNumber(data));
        force->setTetherLengthScale(fabs(drawNumber(data)));
        force->setRepulsion(fabs(drawNumber(data)), fabs(drawNumber(data)), data.ConsumeIntegralInRange(0, 20),
                            data.ConsumeIntegralInRange(0, 2));
    }
    return force.release();
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
    FuzzedDataProvider data(bytes, size);
    static const Membrane blob = createBlob(1), octahedron = createBlob(0);
    const Membrane& membrane = data.ConsumeBool() ? blob : octahedron;
    vector<Vec3> positions = membrane.positions;
    editPositions(data, positions);
    Platform* platform = getPlatforms()[data.ConsumeIntegralInRange(0, 1)];
    try {
        System system;
        fillSystem(system, positions.size(), {createFuzzedForce(data, membrane)});
        bool isNative = data.ConsumeBool();
        HybridMonteCarloIntegrator integrator(fabs(drawNumber(data)), fabs(drawNumber(data)), 3, 0.5,
                                              data.ConsumeBool(), isNative ? "native" : "custom");
        if (isNative && data.ConsumeBool())
            dynamic_cast<HamiltonianTrajectoryIntegrator&>(integrator.getMove(0)).setForcePrecision("mixed");
        integrator.setRandomNumberSeed(1);
        Context context(system, integrator, *platform);
        context.setPositions(positions);
        if (isComputable(context)) {
            integrator.step(3);
            require(isFinite(context.getState(State::Positions).getPositions()),
                    "a position that is not finite after a step");
        }
    }
    catch (const OpenMMException&) {
    }
    return 0;
}
