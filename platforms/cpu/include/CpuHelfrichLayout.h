#ifndef OPENMM_CPUHELFRICHLAYOUT_H_
#define OPENMM_CPUHELFRICHLAYOUT_H_

#include "openmmhelfrich/internal/HelfrichMesh.h"
#include <vector>

namespace HelfrichPlugin {

/**
 * The mesh as the CPU platform's loops read it.  A loop computes all that concerns a vertex from the ring of its
 * neighbors, for a group of as many vertices at a time as a SIMD vector has lanes.
 *
 * Vertices are stored in slots.  Their order, which no result depends on except by rounding, keeps neighbors close in
 * memory: it is the mesh's own, surface by surface and each patch by patch.  Within a patch the vertices are sorted by
 * valence, so that those of a group have equal valences, nearly always.  A ring with fewer than its group's longest is
 * padded with its first neighbor; and the last group of a surface with slots that have nothing but one and the same
 * neighbor.  The triangles that this makes have no area.
 *
 * The layout is a function of the mesh's order and triangles only, and not of the flips that led to them: a simulation
 * that is continued from a checkpoint has the same one.
 */
class CpuHelfrichLayout {
public:
    /**
     * The ring of a group: for each step around it as many neighbors as the group has vertices.
     */
    struct Group {
        int start, length;
        bool isPadded;
        /// the first slot of the surface that the group is a part of
        int origin;
    };
    /**
     * A part of a surface: consecutive vertices of the mesh's order, in consecutive slots.
     */
    struct Part {
        int surface, origin, firstVertex, firstSlot, size;
        int getEnd() const {
            return firstSlot + size;
        }
    };
    /**
     * Choose the size of the layout, which update() fills.
     *
     * @param mesh   the connectivity
     * @param width  the number of vertices in a group
     */
    void initialize(const HelfrichMesh& mesh, int width);
    /**
     * Fill the layout, at first and after each change of the connectivity.  Where few edges have flipped since, most
     * rings are the same but for the slots that neighbors have moved to.
     */
    void update(const HelfrichMesh& mesh, int numThreads);
    /**
     * Divide the surfaces into parts.
     *
     * @param size  the number of vertices of a part, but for the last of each surface: a multiple of the width
     */
    std::vector<Part> divide(const HelfrichMesh& mesh, int size) const;
    int getNumGroups() const {
        return groups.size();
    }
    int getNumSlots() const {
        return groups.size() * width;
    }
    /// the lanes of the widest SIMD vector that there is
    static constexpr int MAX_WIDTH = 16;
    int width = 1;
    std::vector<Group> groups;
    /// the vertex in each slot; the padding's is 0
    std::vector<int> vertices;
    /// the slot of each vertex
    std::vector<int> slots;
    /// the valence of each slot, 0 for padding
    std::vector<int> valences;
    /// four times the slot of each neighbor: the offset of its position.  Between the rings of two patches there is
    /// some room.
    std::vector<int> neighbors;
private:
    void fillAll(const HelfrichMesh& mesh, const std::vector<Part>& patches, int numThreads);
    /**
     * Move the slots of patches and their rings, all but those of vertices around which the connectivity has changed.
     *
     * @return false if there is too little room for the rings of a patch: everything must be filled
     */
    bool moveAll(const HelfrichMesh& mesh, const std::vector<Part>& patches, int numThreads);
    void fillSlots(const HelfrichMesh& mesh, const Part& patch);
    int findLastGroup(const Part& patch) const {
        return (patch.getEnd() + width - 1) / width;
    }
    int measureRings(const Part& patch) const;
    void placeGroups(const Part& patch, int start);
    void moveRings(const Part& patch, int start);
    int* getRing(int slot) {
        return &neighbors[groups[slot / width].start + slot % width];
    }
    void padRing(int slot);
    /**
     * Fill the rings of some slots, as the mesh has them.
     */
    void fillRings(const HelfrichMesh& mesh, const std::vector<int>& chosen);
    void fillRings(const HelfrichMesh& mesh, const int* chosen, int count);
    static constexpr long long NONE = -1;
    /// that of the mesh at the last update
    long long revision = NONE;
    /// where the rings of each patch begin, and where those of the last end
    std::vector<int> patchStarts;
    /// the slot to which the vertex in each slot moves
    std::vector<int> moves;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUHELFRICHLAYOUT_H_*/
