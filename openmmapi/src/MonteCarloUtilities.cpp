#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include "openmmhelfrich/MonteCarloMove.h"
#include "openmm/ATMForce.h"
#include "openmm/AndersenThermostat.h"
#include "openmm/CompoundIntegrator.h"
#include "openmm/CustomCVForce.h"
#include "openmm/MonteCarloAnisotropicBarostat.h"
#include "openmm/MonteCarloBarostat.h"
#include "openmm/MonteCarloFlexibleBarostat.h"
#include "openmm/MonteCarloMembraneBarostat.h"

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

template <class... Classes>
static bool isAnyOf(const Force& force) {
    return ((dynamic_cast<const Classes*>(&force) != NULL) || ...);
}

static bool hasOnlyMonteCarloMoves(const Integrator& integrator) {
    auto compound = dynamic_cast<const CompoundIntegrator*>(&integrator);
    if (compound == NULL)
        return dynamic_cast<const MonteCarloMove*>(&integrator) != NULL;
    for (int i = 0; i < compound->getNumIntegrators(); i++)
        if (!hasOnlyMonteCarloMoves(compound->getIntegrator(i)))
            return false;
    return true;
}

void HelfrichPlugin::requireActingForces(ContextImpl& context, const string& integrator) {
    const System& system = context.getSystem();
    for (int i = 0; i < system.getNumForces(); i++) {
        const Force& force = system.getForce(i);
        bool isBarostat = isAnyOf<MonteCarloBarostat, MonteCarloAnisotropicBarostat, MonteCarloFlexibleBarostat,
                                  MonteCarloMembraneBarostat>(force);
        if ((isBarostat || isAnyOf<AndersenThermostat>(force)) && hasOnlyMonteCarloMoves(context.getIntegrator()))
            throw OpenMMException(integrator + ": force " + to_string(i) + " of the System, '" + force.getName() +
                                  "', would never act: " +
                                  (isBarostat ? "Monte Carlo moves keep the box as it is"
                                              : "Monte Carlo moves have a temperature of their own") +
                                  "; take it out of the System, or use one of OpenMM's Integrators for the "
                                  "trajectories");
    }
}

static const HelfrichForce* findMembrane(const Force& force) {
    // Such Forces may have each other inside.

    if (auto membrane = dynamic_cast<const HelfrichForce*>(&force))
        return membrane;
    const HelfrichForce* found = NULL;
    if (auto outer = dynamic_cast<const CustomCVForce*>(&force))
        for (int i = 0; i < outer->getNumCollectiveVariables() && found == NULL; i++)
            found = findMembrane(outer->getCollectiveVariable(i));
    if (auto outer = dynamic_cast<const ATMForce*>(&force))
        for (int i = 0; i < outer->getNumForces() && found == NULL; i++)
            found = findMembrane(outer->getForce(i));
    return found;
}

const HelfrichForce* HelfrichPlugin::findHiddenMembrane(const System& system) {
    for (int i = 0; i < system.getNumForces(); i++) {
        const Force& force = system.getForce(i);
        if (auto found = isAnyOf<HelfrichForce>(force) ? NULL : findMembrane(force))
            return found;
    }
    return NULL;
}
