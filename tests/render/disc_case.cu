#include "disc_case.h"
#include "render/tiles/blend_cuda.h"
#include "render/tiles/tiles_cuda.h"

namespace tvsgs::test {

DiscResult blend_discs_cuda(const DiscCase& in) {
    return blend_discs<Cuda>(in);
}

}  // namespace tvsgs::test
