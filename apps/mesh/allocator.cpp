// Configures jemalloc for this program, whose arrays of hundreds of megabytes are allocated and
// freed stage by stage: pages of 2 MiB, kept for half a minute. Otherwise threads wait a third of
// the time for 4 KiB pages that the system has to clear.

extern "C" {
// The name is jemalloc's; the environment variable MALLOC_CONF overrides it.
extern const char* malloc_conf;
const char* malloc_conf = "thp:always,dirty_decay_ms:30000";
}
