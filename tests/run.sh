# Runs the tests in two processes, one for each core that even small machines have, and adds up what they print.
filter=${1:-}
./build/tests "$filter" 1 2 >build/share.1 2>&1 &
./build/tests "$filter" 0 2 >build/share.0 2>&1
first=$?
wait $!
second=$?
awk '
    / passed, [0-9]+ failed/ && $1 !~ /^[0-9]/ {  # "area  N passed, N failed; notes"
        if (!($1 in passed)) areas[++count] = $1
        passed[$1] += $2
        failed[$1] += $4
        if (at = index($0, ";")) notes[$1] = notes[$1] substr($0, at)
        next
    }
    /^[0-9]+ passed, [0-9]+ failed$/ { whole_passed += $1; whole_failed += $3; ++ended; next }
    { print }
    END {
        if (ended < 2) { print "a process did not run to its end"; ++whole_failed }
        for (k = 1; k <= count; ++k)
            printf "%-8s %d passed, %d failed%s\n", areas[k], passed[areas[k]], failed[areas[k]], notes[areas[k]]
        printf "%d passed, %d failed\n", whole_passed, whole_failed
    }' build/share.0 build/share.1
[ $first = 0 ] && [ $second = 0 ]
