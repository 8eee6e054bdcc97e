#include "ReferenceHelfrichKernels.h"
#include "openmm/internal/ContextImpl.h"
#include "openmm/reference/ReferencePlatform.h"

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static ReferencePlatform::PlatformData& getData(ContextImpl& context) {
    return *reinterpret_cast<ReferencePlatform::PlatformData*>(context.getPlatformData());
}

void ReferenceCalcHelfrichForceKernel::initialize(const System& system, const HelfrichMesh& mesh) {
    this->mesh = &mesh;
}

ReferenceHelfrichEnergy::Vectors ReferenceCalcHelfrichForceKernel::getVertexPositions(ContextImpl& context) const {
    const vector<Vec3>& positions = *getData(context).positions;
    ReferenceHelfrichEnergy::Vectors x;
    for (int particle : mesh->getParticles())
        x.push_back({positions[particle][0], positions[particle][1], positions[particle][2]});
    return x;
}

HelfrichEnergyTerms ReferenceCalcHelfrichForceKernel::execute(ContextImpl& context, const HelfrichParameters& parameters, bool includeForces) {
    auto x = getVertexPositions(context);
    ReferenceHelfrichEnergy energy(*mesh, x);
    if (includeForces) {
        vector<Vec3>& forces = *getData(context).forces;
        auto gradient = energy.computeGradient(parameters);
        for (int v = 0; v < mesh->getNumVertices(); v++)
            forces[mesh->getParticles()[v]] -= Vec3(gradient[v][0], gradient[v][1], gradient[v][2]);
    }
    return energy.computeEnergy(parameters);
}

HelfrichGeometry ReferenceCalcHelfrichForceKernel::computeGeometry(ContextImpl& context) {
    auto x = getVertexPositions(context);
    return ReferenceHelfrichEnergy(*mesh, x).getGeometry();
}
