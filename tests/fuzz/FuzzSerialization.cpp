/* Serialized forces, integrators and states of integrators with some of their properties and nodes changed.  The XML
 * around them is OpenMM's own to read. */

#include "Fuzzing.h"
#include "openmm/serialization/SerializationNode.h"
#include "openmm/serialization/SerializationProxy.h"
#include <memory>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static void collectNodes(SerializationNode& node, vector<SerializationNode*>& nodes) {
    nodes.push_back(&node);
    for (auto& child : node.getChildren())
        collectNodes(child, nodes);
}

/**
 * Replace a piece of a text: of long lists of numbers too few would be left otherwise.
 */
static string editText(FuzzedDataProvider& data, string text) {
    size_t start = data.ConsumeIntegralInRange<size_t>(0, text.size());
    size_t length = data.ConsumeBool() ? text.size() : data.ConsumeIntegralInRange(0, 12);
    return text.replace(start, min(length, text.size() - start), data.ConsumeRandomLengthString(24));
}

static void editNode(FuzzedDataProvider& data, SerializationNode& root) {
    vector<SerializationNode*> nodes;
    collectNodes(root, nodes);
    SerializationNode& node = *nodes[data.ConsumeIntegralInRange<size_t>(0, nodes.size() - 1)];
    const map<string, string> properties = node.getProperties();
    vector<SerializationNode>& children = node.getChildren();
    int kind = data.ConsumeIntegralInRange(0, 5);
    if (kind < 4 && !properties.empty()) {
        auto property = next(properties.begin(), data.ConsumeIntegralInRange<size_t>(0, properties.size() - 1));
        node.setStringProperty(property->first, editText(data, property->second));
    }
    else if (!children.empty()) {
        auto child = children.begin() + data.ConsumeIntegralInRange<size_t>(0, children.size() - 1);
        if (kind == 4)
            children.erase(child);
        else
            child->setName(editText(data, child->getName()));
    }
}

static void editNodes(FuzzedDataProvider& data, SerializationNode& root) {
    int numEdits = data.ConsumeIntegralInRange(0, 4);
    for (int i = 0; i < numEdits; i++)
        editNode(data, root);
}

static HelfrichForce* createFixedForce(const Membrane& membrane) {
    HelfrichForce* force = createForce(membrane, createParameters(membrane, EveryTerm, 2));
    force->addFixedEdge(membrane.triangles[0][0], membrane.triangles[0][1]);
    force->setTargetVolume(1.5, 0);
    return force;
}

template <class T>
static unique_ptr<T> readFuzzed(FuzzedDataProvider& data, const T& object) {
    SerializationNode root;
    SerializationNode& node = root.createChildNode("Object", &object);
    editNodes(data, node);
    return unique_ptr<T>(node.decodeObject<T>());
}

static void fuzzForce(FuzzedDataProvider& data, const Membrane& membrane, Platform& platform) {
    unique_ptr<HelfrichForce> original(createFixedForce(membrane));
    unique_ptr<Force> force = readFuzzed<Force>(data, *original);
    if (dynamic_cast<HelfrichForce*>(force.get()) == NULL)
        return;
    System system;
    fillSystem(system, membrane.positions.size(), {dynamic_cast<HelfrichForce*>(force.release())});
    EdgeFlipIntegrator flips(300, 0.5);
    Context context(system, flips, platform);
    context.setPositions(membrane.positions);
    if (isComputable(context))
        flips.step(1);
}

static void fuzzIntegrator(FuzzedDataProvider& data, const Membrane& membrane, Platform& platform) {
    HybridMonteCarloIntegrator original(300, 0.001, 2, 1.0, 0.5, data.ConsumeBool() ? "native" : "custom");
    unique_ptr<Integrator> integrator = readFuzzed<Integrator>(data, original);
    System system;
    fillSystem(system, membrane.positions.size(), {createFixedForce(membrane)});
    Context context(system, *integrator, platform);
    context.setPositions(membrane.positions);
}

static void fuzzParameters(FuzzedDataProvider& data, const Membrane& membrane, Platform& platform) {
    System system;
    fillSystem(system, membrane.positions.size(), {createFixedForce(membrane)});
    OpenIntegrator integrator;
    Context context(system, integrator, platform);
    context.setPositions(membrane.positions);
    integrator.step(2);
    SerializationNode node;
    integrator.serializeParameters(node);
    editNodes(data, node);
    try {
        integrator.deserializeParameters(node);
    }
    catch (const OpenMMException&) {
        // Whatever was taken from it before the error: the simulation is one that can go on.
    }
    require(isComputable(context), "a simulation after a damaged State");
    integrator.step(2);
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
    FuzzedDataProvider data(bytes, size);
    static const Membrane blob = createBlob(1), octahedron = createBlob(0);
    const Membrane& membrane = data.ConsumeBool() ? blob : octahedron;
    Platform& platform = *getPlatforms()[data.ConsumeIntegralInRange(0, 1)];
    auto fuzz = data.PickValueInArray({fuzzForce, fuzzIntegrator, fuzzParameters});
    try {
        fuzz(data, membrane, platform);
    }
    catch (const OpenMMException&) {
    }
    return 0;
}
