#!/bin/sh
# shaders.sh PART FOLDER [WRITER]: every variant of the emitter's text through the compilers of PART, a warning being a
# failure. WRITER.c beside this file writes them: variants (the default), frusta_variants.
#   glsl    glslangValidator on all GLSL dialects, spirv-val on Vulkan's
#   c       gcc with all warnings on the C
#   hlsl    Microsoft's compilers under wine; HLSL_DLLS is a folder with msfxc.dll, msfxc_old.dll, msdxc.dll
part=$1
dir=$2
writer=${3:-variants}
here=$(dirname "$0")
wine=$(command -v wine64 || echo /usr/lib/wine/wine64)
samples=${SHADER_SAMPLES:-300}
mkdir -p "$dir"
gcc -std=c99 -O1 -I"$here/../.." "$here/$writer.c" -o "$dir/variants" -lm || exit 1
failed=0
write() { # DIALECT
    rm -rf "$dir/$1"
    mkdir -p "$dir/$1"
    "$dir/variants" "$1" "$dir/$1" "$samples" | tee -a "$dir/count" || failed=1
}
: >"$dir/count"
case $part in
glsl)
    for dialect in glsl330 glsl430 glsl450 es300 es310; do
        write $dialect
        (cd "$dir/$dialect" && ls | xargs -n 200 glslangValidator) >"$dir/$dialect.log" 2>&1 || failed=1
        if grep -E 'ERROR|WARNING' "$dir/$dialect.log"; then failed=1; fi
    done
    write vulkan
    (cd "$dir/vulkan" && ls | xargs -n 1 -I F glslangValidator -V F -o F.spv) >"$dir/vulkan.log" 2>&1 || failed=1
    if grep -E 'ERROR|WARNING' "$dir/vulkan.log"; then failed=1; fi
    for file in "$dir"/vulkan/*.spv; do spirv-val --target-env vulkan1.0 "$file" || failed=1; done
    ;;
c)
    write c99
    (cd "$dir/c99" && ls | xargs -n 50 gcc -std=c99 -Wall -Wextra -Wpedantic -Wconversion -Wsign-conversion -Wshadow -Wundef -Werror \
        -fsyntax-only) || failed=1
    ;;
hlsl)
    x86_64-w64-mingw32-gcc -O1 "$here/hlsl.c" -o "$dir/hlsl.exe" || exit 1
    cp "$HLSL_DLLS"/*.dll "$dir/"
    write hlsl50
    write hlsl60
    cd "$dir" || exit 1
    WINEPREFIX=$PWD/wine WINEARCH=win64 WINEDEBUG=-all WINEDLLOVERRIDES="mscoree,mshtml="
    export WINEPREFIX WINEARCH WINEDEBUG WINEDLLOVERRIDES
    [ -d wine ] || timeout 120 "$wine" wineboot -i </dev/null >/dev/null 2>&1
    for compiler in "msfxc.dll 5_0 hlsl50" "msfxc_old.dll 5_0 hlsl50" "msdxc.dll 6_0 hlsl60"; do
        # shellcheck disable=SC2086
        set -- $compiler
        [ -f "$1" ] || { echo "$1: not there"; continue; }
        ls "$3"/*.hlsl | xargs -n 25 timeout 120 "$wine" hlsl.exe "$1" "$2" >"$1.log" 2>&1 || failed=1
        awk -v name="$1" '/^compiled /{good += $2; bad += $4} END {print name ": " good + 0 " compiled, " bad + 0 " failed"}' "$1.log" | tee -a count
        grep -v '^compiled ' "$1.log" | grep . | head -n 10
    done
    ;;
esac
exit $failed
