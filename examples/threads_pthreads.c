/* threads_pthreads: a cone map built by as many threads as there are processors, with POSIX threads. Everything that a
   host needs is parallel_for: threads that take the next job until none is left. The bits do not depend on the split, which
   the program checks. */
#if !defined(_POSIX_C_SOURCE)
#define _POSIX_C_SOURCE 200809L
#endif
#define CONEMAP_IMPLEMENTATION
#include "../conemap.h"

#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

enum { SIDE = 512, MOST_THREADS = 64 };

/* One call of parallel_for: the jobs that are left. */
struct jobs {
    pthread_mutex_t lock;
    int next, count;
    conemap_job *job;
    void *context;
};

static void *work(void *argument) {
    struct jobs *jobs = argument;
    for (;;) {
        pthread_mutex_lock(&jobs->lock);
        int index = jobs->next++;
        pthread_mutex_unlock(&jobs->lock);
        if (index >= jobs->count) return NULL;
        jobs->job(jobs->context, index);
    }
}

/* desc.parallel_for: runs all jobs and returns when they are done. user: the number of threads. */
static void parallel_for(int count, conemap_job *job, void *context, void *user) {
    struct jobs jobs = {PTHREAD_MUTEX_INITIALIZER, 0, count, job, context};
    pthread_t threads[MOST_THREADS];
    int wanted = *(const int *)user, started = 0;
    while (started < wanted - 1 && pthread_create(&threads[started], NULL, work, &jobs) == 0) ++started;
    work(&jobs); /* this thread helps, so the work is done even where no other could be started */
    while (started > 0) pthread_join(threads[--started], NULL);
    pthread_mutex_destroy(&jobs.lock);
}

int main(void) {
    static unsigned char heights[SIDE * SIDE];
    long processors = sysconf(_SC_NPROCESSORS_ONLN);
    int threads = processors < 1 ? 1 : processors > MOST_THREADS ? MOST_THREADS : (int)processors;
    conemap_desc desc;
    conemap_map alone, together;
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
