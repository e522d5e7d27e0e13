#!/usr/bin/env bash
# Judges the recordings that have arrived since the last run. For cron and systemd: see README.md beside this.
#
#   STATION=/srv/enginediag [ALARM=/usr/local/bin/alarm_by_mail] nightly.sh
#
#   incoming/SERIAL_*.csv   recordings, judged by engines/SERIAL.yaml as `enginediag identify` wrote it
#   results/                verdicts of each recording and, where there is a finding, what changed
#   rejected/               recordings that cannot be judged
#   alarms/                 what ALARM was told: called with a subject, the message on standard input
#
# Whatever one recording ends with, the others are judged.
# Ends with 0 nothing found, 1 a finding, 2 trouble with the options, a recording or ALARM, 75 another run is at work.
set -euo pipefail

cd "${STATION:?is not set: the folder of the station}"
mkdir -p incoming results rejected alarms work
exec 9>nightly.lock
if ! flock --nonblock 9; then
    echo "another run is at work in $STATION" >&2
    exit 75
fi

trap 'rm -f work/*' EXIT
findings=0 troubles=0

note() { # NAME SUBJECT < MESSAGE: kept until ALARM has taken it
    { echo "$2" && cat; } >"work/$1.alarm"
    mv "work/$1.alarm" "alarms/$1.unsent"
}

trouble() { # NAME WHAT: with what was said of it; what does not end is told every night
    note "$1" "$1: $2" <"work/$1.said"
    troubles=$((troubles + 1))
}

refused() { # RECORDING NAME NOMINAL: by fault of the recording, of the nominal file, or of neither, as on a full disk
    if ! enginediag check "$3" >/dev/null 2>>"work/$2.said" 9>&-; then
        trouble "$2" "no nominal engine that can be used: $3"
    elif enginediag check -n "$3" "$1" >/dev/null 2>>"work/$2.said" 9>&-; then
        trouble "$2" "could not be judged this time"
    else
        mv "$1" rejected/
        trouble "$2" "is no recording that can be judged: put into rejected/"
    fi
}

judge() { # RECORDING
    local recording=$1 name serial nominal code=0
    name=$(basename "$recording")
    name=${name%%.csv*}
    serial=${name%%_*}
    nominal=engines/$serial.yaml
    if [[ results/$name.detect.csv -nt $recording && results/$name.detect.csv -nt $nominal ]]; then
        return # judged before
    fi
    enginediag detect -n "$nominal" "$recording" --exit-code -o "work/$name.detect.csv" 9>&- 2>"work/$name.said" || code=$?
    case $code in
        0 | 3) ;; # nothing found; or no verdict, which the rows explain and the log keeps
        1)
            enginediag isolate -n "$nominal" "$recording" -o "work/$name.isolate.csv" 9>&- 2>"work/$name.said" || code=$?
            if ((code > 1)); then
                echo "isolate ended with $code: what changed is not known" >>"work/$name.said"
                troubles=$((troubles + 1))
            else
                mv "work/$name.isolate.csv" results/
            fi
            note "$name" "$name: a change was found" <"work/$name.said"
            findings=$((findings + 1))
            ;;
        2)
            refused "$recording" "$name" "$nominal"
            return
            ;;
        *) # killed, or a fault of the program: tried again in the next run
            trouble "$name" "detect ended with $code, and is tried again in the next run"
            return
            ;;
    esac
    mv "work/$name.detect.csv" results/ # last: until it is there, the recording counts as not judged
}

if [[ -e enginediag.yaml ]] && ! enginediag check enginediag.yaml >/dev/null 9>&-; then
    exit 2 # said above; no recording is to suffer for it
fi

# a file that was written to in the last two minutes may still be arriving
while IFS= read -r -d '' recording; do
    judge "$recording"
done < <(find incoming -maxdepth 1 -type f \( -name '*.csv' -o -name '*.csv.gz' \) -mmin +2 -print0 | sort -z)

for message in alarms/*.unsent; do
    [[ -e $message ]] || continue
    subject=$(head -n 1 "$message")
    if [[ -z ${ALARM:-} ]]; then
        cat "$message" # cron mails what a job prints
    elif ! "$ALARM" "$subject" <"$message" 9>&-; then
        echo "$ALARM failed; $message is kept for the next run" >&2
        troubles=$((troubles + 1))
        continue
    fi
    mv "$message" "${message%.unsent}.sent"
done

if ((troubles)); then exit 2; fi
if ((findings)); then exit 1; fi
