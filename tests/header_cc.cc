// The header and its implementation as C++11. Compiled on its own, or linked as a program:
//     c++ -std=c++11 -I.. header_cc.cc && ./a.out
#define CONEMAP_IMPLEMENTATION
#include "conemap.h"

#include "header.h"

int main()
{
    static const float heights[4] = {0.0f, 0.25f, 0.5f, 1.0f};
    return header_cone(heights) > 0.0f ? 0 : 1;
}
