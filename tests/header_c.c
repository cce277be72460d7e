/* The header without its implementation, twice, in C; and the copies of the other files against it. */
#include "conemap.h"
#include "conemap.h"

#include "header.h"
#include "test.h"

float static_a_cone(const float heights[4]);
float static_b_cone(const float heights[4]);

static void copies_agree(void)
{
    static const float heights[4] = {0.0f, 0.25f, 0.5f, 1.0f};
    const float cone = header_cone(heights);
    CHECK(cone > 0.0f && cone <= 0.7072f, "cone %g", (double)cone);
#ifndef TEST_NO_COPIES
    CHECK(static_a_cone(heights) == cone, "copy a: %g", (double)static_a_cone(heights));
    CHECK(static_b_cone(heights) == cone, "copy b: %g", (double)static_b_cone(heights));
#endif
}

/* A zeroed desc means the defaults. */
static void constants(void)
{
    const int defaults[] = {CONEMAP_OK,
                            CONEMAP_F32,
                            CONEMAP_CLAMP,
                            CONEMAP_LINEAR,
                            CONEMAP_HEIGHT_CONE,
                            CONEMAP_GENERATE_DEFAULT,
                            CONEMAP_TRACE_DEFAULT,
                            CONEMAP_HIT,
                            CONEMAP_REFINE_NONE};
    int k;
    for (k = 0; k < (int)(sizeof defaults / sizeof defaults[0]); ++k) {
        CHECK(defaults[k] == 0, "default %d is %d", k, defaults[k]);
    }
}

const struct test_case header_tests[] = {
    {"private copies agree", copies_agree},
    {"zero is the default", constants},
    {NULL, NULL},
};
