#include "openmmhelfrich/MonteCarloMove.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include <algorithm>
#include <cctype>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * What the name of a class begins with in a checkpoint, and its greatest length.
 */
static const char MAGIC_BYTES[] = "HlfMove:";
static const int MAX_LENGTH = 100;

void MonteCarloMove::writeName(ostream& stream, const string& name) {
    writeMagic(stream, MAGIC_BYTES);
    writeBinary(stream, (int) name.size());
    stream.write(name.data(), name.size());
}

bool MonteCarloMove::readName(istream& stream, const string& name) {
    if (!readMagic(stream, MAGIC_BYTES))
        return false;
    int length;
    readBinary(stream, length);
    string found(min(max(length, 0), MAX_LENGTH), ' ');
    stream.read(&found[0], found.size());
    if (!all_of(found.begin(), found.end(), [](unsigned char c) { return isalnum(c); }))
        throw OpenMMException(name + ": the checkpoint is damaged");
    if (found != name)
        throw OpenMMException(name + ": the checkpoint is of the class " + found);
    return true;
}

void MonteCarloMove::requireEnd(istream& stream, const Integrator& integrator, ContextImpl& context,
                                const string& name) {
    if (&context.getIntegrator() == &integrator && stream.peek() != istream::traits_type::eof())
        throw OpenMMException(name + ": the checkpoint is of another class");
}

void MonteCarloMove::requireContext(const ContextImpl* context) {
    if (context == NULL)
        throw OpenMMException("This Integrator is not bound to a context!");
}

long long& MonteCarloMove::addCounter(const string& name) {
    counters.push_back({name, 0});
    return counters.back().second;
}

void MonteCarloMove::resetCounters() {
    for (auto& counter : counters)
        counter.second = 0;
}

void MonteCarloMove::writeCounters(ostream& stream) const {
    for (auto& counter : counters)
        writeBinary(stream, counter.second);
}

void MonteCarloMove::readCounters(istream& stream) {
    for (auto& counter : counters)
        readBinary(stream, counter.second);
}

void MonteCarloMove::storeCounters(SerializationNode& node) const {
    for (auto& counter : counters)
        node.setLongProperty(counter.first, counter.second);
}

void MonteCarloMove::loadCounters(const SerializationNode& node) {
    for (auto& counter : counters) {
        if (!node.hasProperty(counter.first))
            throw OpenMMException("The State is of another class of Integrator: it has no '" + counter.first + "'");
        counter.second = node.getLongProperty(counter.first);
    }
}

void SeededMove::setRandomNumberSeed(int seed) {
    randomNumberSeed = seed;
    activeSeed = chooseSeed(seed);
}

void SeededMove::bind(ContextImpl& newContext, ContextImpl*& context, Context*& owner) {
    if (owner != NULL && &newContext.getOwner() != owner)
        throw OpenMMException("This Integrator is already bound to a context");
    context = &newContext;
    owner = &newContext.getOwner();
    activeSeed = chooseSeed(randomNumberSeed);
    resetCounters();
}

Philox SeededMove::getRandom(unsigned int stream) const {
    return Philox(activeSeed, stream);
}

void SeededMove::writeSeedAndCounters(ostream& stream) const {
    writeBinary(stream, activeSeed);
    writeCounters(stream);
}

void SeededMove::readSeedAndCounters(istream& stream) {
    readBinary(stream, activeSeed);
    readCounters(stream);
}

void SeededMove::storeSeedAndCounters(SerializationNode& node) const {
    node.setIntProperty("activeSeed", (int) activeSeed);
    storeCounters(node);
}

void SeededMove::loadSeedAndCounters(const SerializationNode& node) {
    activeSeed = (unsigned int) node.getIntProperty("activeSeed");
    loadCounters(node);
}
