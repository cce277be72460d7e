/* threads_c11: the same as threads_pthreads with the threads of C11, which know no number of processors: give one. */
#define CONEMAP_IMPLEMENTATION
#include "../conemap.h"

#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <threads.h>

enum { SIDE = 512, MOST_THREADS = 64 };

/* One call of parallel_for: the jobs that are left. */
struct jobs {
    atomic_int next;
    int count;
    conemap_job *job;
    void *context;
};

static int work(void *argument) {
    struct jobs *jobs = argument;
    int index;
    while ((index = atomic_fetch_add(&jobs->next, 1)) < jobs->count) jobs->job(jobs->context, index);
    return 0;
}

/* desc.parallel_for: runs all jobs and returns when they are done. user: the number of threads. */
static void parallel_for(int count, conemap_job *job, void *context, void *user) {
    struct jobs jobs;
    thrd_t threads[MOST_THREADS];
    int wanted = *(const int *)user, started = 0;
    atomic_init(&jobs.next, 0);
    jobs.count = count;
    jobs.job = job;
    jobs.context = context;
    while (started < wanted - 1 && thrd_create(&threads[started], work, &jobs) == thrd_success) ++started;
    work(&jobs); /* this thread helps, so the work is done even where no other could be started */
    while (started > 0) thrd_join(threads[--started], NULL);
}

int main(int argc, char **argv) {
    static unsigned char heights[SIDE * SIDE];
    int threads = argc > 1 ? atoi(argv[1]) : 2;
    conemap_desc desc;
    conemap_map alone, together;
    if (threads < 1 || threads > MOST_THREADS) threads = 2;
    for (int k = 0; k < SIDE * SIDE; ++k) heights[k] = (unsigned char)((k % SIDE * 7 ^ k / SIDE * 5) & 255);
    memset(&desc, 0, sizeof desc);
    desc.heights.pixels = heights;
    desc.heights.format = CONEMAP_UNORM8;
    desc.heights.width = desc.heights.height = SIDE;
    if (conemap_build(&desc, &alone) != CONEMAP_OK) return 1;
    desc.parallel_for = parallel_for;
    desc.parallel_user = &threads;
    if (conemap_build(&desc, &together) != CONEMAP_OK) return 1;
    int same = memcmp(alone.cones, together.cones, sizeof(float) * SIDE * SIDE) == 0;
    printf("%d threads: %s\n", threads, same ? "the same bits as one" : "DIFFERENT BITS");
    conemap_free(&alone);
    conemap_free(&together);
    return !same;
}
