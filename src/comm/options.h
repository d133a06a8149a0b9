// Keys comm.*: how many photographs a step looks at, and what its processes expect of each other.
#pragma once

#include <string>

namespace tvsgs {

struct CommOptions {
    int batch = 1;
    int timeout = 300;
    std::string rendezvous;

    template <class Visitor>
    void fields(Visitor& field) {
        field("batch", batch, {1, 1024},
              "photographs that a step looks at; at most so many processes share its work, and the "
              "results do not depend on how many do");
        field("timeout", timeout, {1, 1e6},
              "seconds that a process waits for another one that should be at work, before it ends "
              "the run");
        field("rendezvous", rendezvous,
              "file by which processes that no MPI has started find each other; all see it");
    }
};

}  // namespace tvsgs
