#!/bin/sh
# shaders.sh PART FOLDER [WRITER]: every variant of the emitter's text through the compilers of PART, a warning being a
# failure. WRITER.c beside this file writes them: variants (the default), frusta_variants.
#   glsl    glslangValidator on all GLSL dialects, or glslc for Vulkan's where it is there, and spirv-val on those
#   c       gcc with all warnings on the C
#   hlsl    Microsoft's compilers under wine; HLSL_DLLS is a folder with msfxc.dll, msfxc_old.dll, msdxc.dll
#   wgsl    Tint and naga in node; WGSL_MODULES is the folder that npm put webgpu and naga-wasm into
#   msl     clang, with metal_stdlib beside this file in Metal's place
#   hlslrun a choice of HLSL and of Vulkan's GLSL run on a software GPU, by way of SPIR-V and GLSL: HLSL through
#           Microsoft's compiler if HLSL_DLLS has one that writes SPIR-V (msdxc_spirv.dll), else through glslang
part=$1
dir=$2
writer=${3:-variants}
here=$(dirname "$0")
wine=$(command -v wine64 || echo /usr/lib/wine/wine64)
samples=${SHADER_SAMPLES:-300}
mkdir -p "$dir"
under_wine() {
    WINEPREFIX=$PWD/wine WINEARCH=win64 WINEDEBUG=-all WINEDLLOVERRIDES="mscoree,mshtml="
    export WINEPREFIX WINEARCH WINEDEBUG WINEDLLOVERRIDES
    [ -d wine ] || timeout 120 "$wine" wineboot -i </dev/null >/dev/null 2>&1
}
# compile LIBRARY PROFILE FILE...: a run that wine itself breaks off doesn't come to say what it compiled, and is repeated.
compile() {
    for try in first second third; do
        timeout 300 "$wine" hlsl.exe "$@" </dev/null >run.log 2>&1
        status=$?
        if grep -q '^compiled ' run.log; then break; fi
        echo "$try try broken off, exit status $status" >>broken.log
    done
    cat run.log
    return $status
}
if [ "$part" = hlslrun ]; then
    gcc -std=c99 -O2 -I"$here/../.." "$here/gl.c" -o "$dir/gl" -lEGL -lm || exit 1
    cd "$dir" || exit 1
    rm -rf texts
    mkdir texts
    EGL_PLATFORM=surfaceless ./gl hlsl-write texts || exit $?
    if [ -f "${HLSL_DLLS:-}/msdxc_spirv.dll" ]; then
        x86_64-w64-mingw32-gcc -O1 "$OLDPWD/$here/hlsl.c" -o hlsl.exe || exit 1
        cp "$HLSL_DLLS/msdxc_spirv.dll" .
        under_wine
        compile msdxc_spirv.dll spirv texts/*.hlsl || exit 1
    else
        for file in texts/*.hlsl; do
            glslangValidator -D -V -e main -S comp --sbb 8 --sib 8 --ssb 16 --sub 24 "$file" -o "$file.spv" >"$file.log" ||
                { cat "$file.log"; exit 1; }
        done
    fi
    for file in texts/*.vulkan; do glslangValidator -V -S comp "$file" -o "$file.spv" >"$file.log" || { cat "$file.log"; exit 1; }; done
    for file in texts/*.hlsl texts/*.vulkan; do
        spirv-cross --version 450 --no-es --glsl-emit-push-constant-as-ubo "$file.spv" --output "${file%.*}.comp" || exit 1
    done
    EGL_PLATFORM=surfaceless ./gl hlsl-run texts >run.log
    status=$?
    cat run.log
    tail -n 1 run.log >count
    exit $status
fi
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
    # whole shaders linked, each by itself: that outputs lack places is told only then
    (cd "$dir/es300" && ls | grep fragment | xargs -r -n 1 glslangValidator -l) >"$dir/linked.log" 2>&1 || failed=1
    if grep -E 'ERROR|WARNING' "$dir/linked.log"; then failed=1; fi
    write vulkan
    if command -v glslc >/dev/null; then # the same compiler, but many files a call, each by itself
        (cd "$dir/vulkan" && ls | xargs -n 100 glslc -Werror --target-env=vulkan1.0 -c) >"$dir/vulkan.log" 2>&1 || failed=1
    else
        (cd "$dir/vulkan" && ls | xargs -I F glslangValidator -V F -o F.spv) >"$dir/vulkan.log" 2>&1 || failed=1
    fi
    if grep -iE 'error|warning' "$dir/vulkan.log"; then failed=1; fi
    [ "$(ls "$dir/vulkan" | wc -l)" = $((2 * $(ls "$dir/vulkan" | grep -vc 'spv$'))) ] || failed=1 # one for each
    for file in "$dir"/vulkan/*.spv; do spirv-val --target-env vulkan1.0 "$file" || failed=1; done
    ;;
c)
    write c99
    (cd "$dir/c99" && ls | xargs -n 50 gcc -std=c99 -Wall -Wextra -Wpedantic -Wconversion -Wsign-conversion -Wshadow -Wundef -Werror \
        -fsyntax-only) || failed=1
    ;;
wgsl)
    write wgsl
    node "$here/wgsl.mjs" "$WGSL_MODULES" judge "$dir/wgsl" >"$dir/wgsl.log" 2>&1 || failed=1
    tail -n 12 "$dir/wgsl.log"
    ;;
msl)
    write msl
    { # each in a namespace of its own: as one file they take seconds
        echo '#include <metal_stdlib>'
        for file in "$dir"/msl/*.metal; do
            name=${file##*/}
            printf 'namespace item%s {\n#include "%s"\n}\n' "${name%%_*}" "$name"
        done
    } >"$dir/msl/all.cc"
    clang++ -std=c++14 -fsyntax-only -Wall -Wextra -Werror -Wno-unknown-attributes -Wno-unused-function \
        -Wno-missing-field-initializers -I"$here" "$dir/msl/all.cc" || failed=1
    ;;
hlsl)
    x86_64-w64-mingw32-gcc -O1 "$here/hlsl.c" -o "$dir/hlsl.exe" || exit 1
    cp "$HLSL_DLLS"/*.dll "$dir/"
    write hlsl50
    write hlsl60
    cd "$dir" || exit 1
    under_wine
    for compiler in "msfxc.dll 5_0 hlsl50" "msfxc_old.dll 5_0 hlsl50" "msdxc.dll 6_0 hlsl60"; do
        # shellcheck disable=SC2086
        set -- $compiler
        [ -f "$1" ] || { echo "$1: not there"; continue; }
        step=1
        [ "$1" = msfxc_old.dll ] && step=4
        [ "$writer $2" = "frusta_variants 5_0" ] && step=16 # these take a second each
        ls "$3"/*.hlsl | awk -v step=$step 'NR % step == 0' >files
        xargs -n 25 <files | while read -r batch; do
            # shellcheck disable=SC2086
            compile "$1" "$2" $batch
        done >"$1.log"
        awk -v name="$1" -v files="$(wc -l <files)" '/^compiled /{good += $2; bad += $4}
            END {print name ": " good + 0 " compiled, " bad + 0 " failed"; exit good != files}' "$1.log" >judged || failed=1
        tee -a count <judged
        grep -v '^compiled ' "$1.log" | grep . | head -n 10
    done
    ;;
esac
exit $failed
