/* What the emitter writes, as files. Texts in C (NAME_c.h) are written to build/written/ before the tests are compiled
   (TEST_WRITE), as they are compiled into them and run there. The others lie in tests/golden/, few, so that a change of
   what is emitted can be seen; `make sync` writes them anew. */
#ifndef GOLDEN_H
#define GOLDEN_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

static inline void golden_text(const char *name, const char *text)
{
    const size_t size = strlen(text), length = strlen(name);
    const int compiled = length > 4 && strcmp(name + length - 4, "_c.h") == 0;
#ifdef TEST_WRITE
    const int writes = compiled;
#else
    const int writes = !compiled && getenv("CONEMAP_SYNC") != NULL;
#endif
    char path[64], *file;
    size_t there;
    FILE *stream;
    snprintf(path, sizeof path, "%s%s", compiled ? "build/written/" : "tests/golden/", name);
    if (writes) {
        stream = fopen(path, "wb");
        if (CHECK(stream != NULL, "%s can't be written", path)) {
            fwrite(text, 1, size, stream);
            fclose(stream);
        }
    }
    file = (char *)test_alloc(size + 1);
    stream = fopen(path, "rb");
    there = stream ? fread(file, 1, size + 1, stream) : 0;
    if (stream) fclose(stream);
    CHECK(there == size && memcmp(file, text, size) == 0, "%s: not what is emitted%s", path, compiled ? "" : " (make sync)");
    test_release(file);
}

#endif
