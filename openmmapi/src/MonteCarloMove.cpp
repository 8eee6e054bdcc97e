#include "openmmhelfrich/MonteCarloMove.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

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
    for (auto& counter : counters)
        counter.second = node.getLongProperty(counter.first);
}
