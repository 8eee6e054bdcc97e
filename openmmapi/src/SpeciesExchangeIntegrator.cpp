#include "openmmhelfrich/SpeciesExchangeIntegrator.h"
#include "openmmhelfrich/internal/Interruption.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include "openmmhelfrich/internal/SpeciesProposal.h"
#include <algorithm>
#include <cmath>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * What setProposal() takes, in the order of SpeciesProposal::Kind.
 */
static const char* const PROPOSALS[] = {"neighbors", "anywhere", "mutation"};

static SpeciesProposal::Kind findKind(const string& proposal) {
    auto found = find(begin(PROPOSALS), end(PROPOSALS), proposal);
    if (found == end(PROPOSALS))
        throw OpenMMException("SpeciesExchangeIntegrator: the proposal is '" + proposal +
                              "'; it must be 'neighbors', 'anywhere' or 'mutation'");
    return SpeciesProposal::Kind(found - begin(PROPOSALS));
}

SpeciesExchangeIntegrator::SpeciesExchangeIntegrator(double temperature, double fraction)
        : MonteCarloIntegrator("SpeciesExchangeIntegrator", temperature, true) {
    setFraction(fraction);
}

void SpeciesExchangeIntegrator::setFraction(double fraction) {
    requirePositive("SpeciesExchangeIntegrator: the fraction", fraction, true);
    this->fraction = fraction;
}

void SpeciesExchangeIntegrator::setProposal(const string& proposal) {
    findKind(proposal);
    this->proposal = proposal;
}

static void requireSpecies(int species) {
    if (species < 0)
        throw OpenMMException("SpeciesExchangeIntegrator: the chemical potential is that of species " +
                              to_string(species) + "; species are numbered from 0");
}

double SpeciesExchangeIntegrator::getChemicalPotential(int species) const {
    requireSpecies(species);
    auto found = chemicalPotentials.find(species);
    return found == chemicalPotentials.end() ? 0 : found->second;
}

void SpeciesExchangeIntegrator::setChemicalPotential(int species, double chemicalPotential) {
    requireSpecies(species);
    if (!isfinite(chemicalPotential))
        throw OpenMMException("SpeciesExchangeIntegrator: the chemical potential of species " + to_string(species) +
                              " is " + toText(chemicalPotential) + "; it must be finite");
    chemicalPotentials[species] = chemicalPotential;
}

void SpeciesExchangeIntegrator::initialize(ContextImpl& contextRef) {
    const HelfrichForce* hidden = findHiddenMembrane(contextRef.getSystem());
    if (hidden != NULL && hidden->getNumSpecies() > 0)
        throw OpenMMException("SpeciesExchangeIntegrator: the HelfrichForce '" + hidden->getName() +
                              "' is inside another Force of the System, where it would keep the species that it began "
                              "with; add it to the System itself");
    bool hasSpecies = false;
    for (auto membrane : findMembranes(contextRef))
        hasSpecies |= !membrane->getMesh().getSpecies().empty();
    if (!hasSpecies)
        throw OpenMMException("SpeciesExchangeIntegrator: the System has no HelfrichForce with species that could be "
                              "exchanged; add them with addSpecies()");
    MonteCarloIntegrator::initialize(contextRef);
}

vector<string> SpeciesExchangeIntegrator::getKernelNames() {
    return {ExchangeSpeciesKernel::Name()};
}

bool SpeciesExchangeIntegrator::hasAttempts(const HelfrichForceImpl& membrane) const {
    return fraction > 0 && isIntegrated(membrane) && !membrane.getMesh().getSpecies().empty();
}

long long SpeciesExchangeIntegrator::getNumAttempts(const HelfrichForceImpl& membrane) const {
    double numAttempts = fraction * membrane.getMesh().getNumEdges();
    requireAtMost("SpeciesExchangeIntegrator: the number of attempts in a sweep", numAttempts,
                  ExchangeSpeciesKernel::MAX_ATTEMPTS);
    return max(llround(numAttempts), 1LL);
}

SpeciesProposal SpeciesExchangeIntegrator::createProposal(const HelfrichForceImpl& membrane) const {
    SpeciesProposal result;
    result.kind = findKind(proposal);
    int numSpecies = membrane.getNumSpecies();
    if (!chemicalPotentials.empty() && chemicalPotentials.rbegin()->first >= numSpecies)
        throw OpenMMException("SpeciesExchangeIntegrator: species " + to_string(chemicalPotentials.rbegin()->first) +
                              " has a chemical potential, but there are " + to_string(numSpecies) +
                              " species, numbered from 0");
    for (int species = 0; species < numSpecies; species++)
        result.chemicalPotentials.push_back(getChemicalPotential(species));
    return result;
}

void SpeciesExchangeIntegrator::makeMove() {
    vector<vector<int>> before;
    for (auto membrane : getMembranes())
        before.push_back(membrane->getMesh().getSpecies());
    try {
        SpeciesExchangeStatistics statistics = sweep();
        numAttempted += statistics.attempted;
        numAccepted += statistics.accepted;
        numAlike += statistics.alike;
        numSweeps++;
    }
    catch (const StepInterrupted&) {
        for (size_t n = 0; n < before.size(); n++)
            if (!before[n].empty())
                getMembranes()[n]->setSpecies(*context, before[n]);
        throw;
    }
}

SpeciesExchangeStatistics SpeciesExchangeIntegrator::sweep() {
    SpeciesExchangeStatistics total;
    for (int n = 0; n < (int) getMembranes().size(); n++) {
        HelfrichForceImpl& membrane = *getMembranes()[n];
        if (!hasAttempts(membrane))
            continue;
        SpeciesProposal proposal = createProposal(membrane);
        unsigned int stream = RandomStream::SpeciesExchanges + size(PROPOSALS) * n + proposal.kind;
        SpeciesExchangeStatistics statistics = membrane.exchangeSpecies(
                *context, proposal, getThermalEnergy(), getNumAttempts(membrane), getRandom(stream), numSweeps);
        total.attempted += statistics.attempted;
        total.accepted += statistics.accepted;
        total.alike += statistics.alike;
    }
    return total;
}
