#include "apps/view/server.h"
#include "core/error.h"

namespace tvsgs {

void serve(const ViewInput&, const ViewPageOptions&, int) {
    throw Error(ExitCode::usage,
                "this build has no server, as cpp-httplib was not there (Debian: "
                "libcpp-httplib-dev); give --out FILE.html");
}

}  // namespace tvsgs
