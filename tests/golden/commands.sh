# Commands whose outputs are kept, each after its name; `golden.py` runs them one after another in one scratch folder
# that holds the shipped configs/ and sample_data/. A step may read what earlier steps have written.

# -- flights
flights: sed 's/record_interval_s: 10/record_interval_s: 60/; s/interval_s: 10/interval_s: 60/' configs/flights/airliner.yaml > flights.yaml
simulate_healthy: enginediag simulate configs/turbofan.yaml --flight flights.yaml --flights 3 --seed 1 -q -o healthy.csv
simulate_series: enginediag simulate configs/turbofan.yaml --fault configs/faults/hpc_fouling.yaml --flight flights.yaml --flights 6 --seed 7 --truth truth.csv -o series.csv
simulate_bias: enginediag simulate configs/turbofan.yaml --fault configs/faults/sensor_T3_bias.yaml --flight flights.yaml --flights 5 --seed 8 -o bias.csv
simulate_stuck: enginediag simulate configs/turbofan.yaml --fault configs/faults/sensor_T45_stuck.yaml --flight flights.yaml --flights 4 --seed 9 -q -o stuck.csv
simulate_json: enginediag simulate configs/turboshaft.yaml --flight configs/flights/helicopter.yaml --flights 1 --records 5 --seed 2 -f json
simulate_table: enginediag simulate configs/turboprop.yaml --flights 1 --records 3 --seed 2 -f table --wide
simulate_engines: for e in configs/*.yaml; do echo "$e"; enginediag simulate $e --flight configs/flights/sweep.yaml --flights 1 --records 3 --seed 4 --noise none --no-header 2>&1; done
simulate_quantised: enginediag simulate configs/turbojet.yaml --flights 1 --records 6 --seed 3 --noise quantised -f ndjson
simulate_moving: enginediag simulate configs/micro_gas_turbine.yaml --flights 1 --records 30 --seed 3 --noise correlated -q

# -- identification
identify: enginediag identify configs/turbofan.yaml healthy.csv -o nominal.yaml --picture fit.svg
identify_holdout: enginediag identify configs/turbofan.yaml healthy.csv --holdout 0.3 --no-cross-validation --model-error 0.01 -o holdout.yaml
identify_shaft: enginediag simulate configs/turboshaft.yaml --flight configs/flights/helicopter.yaml --flights 2 --records 40 --seed 5 -q -o shaft.csv && enginediag identify configs/turboshaft.yaml shaft.csv --no-cross-validation -o shaft_nominal.yaml

# -- residuals and detection
residual: enginediag residual -n nominal.yaml --sensors series.csv -q -o statistics.csv
residual_records: enginediag residual -n nominal.yaml --what records series.csv -f ndjson --no-header | head -12
residual_windows: enginediag residual -n nominal.yaml series.csv --window 60 -f json --columns flight,records,chi2,dof
detect: enginediag detect -n nominal.yaml series.csv
detect_table: enginediag detect -n nominal.yaml series.csv -f table --wide --no-header
detect_json: enginediag detect -n nominal.yaml series.csv --window 30 --detectable -f json
detect_bounds: enginediag detect -n nominal.yaml series.csv --window 10 --must-show 'hpc.*=0.02' --picture detect.svg
detect_reference: enginediag detect -n nominal.yaml series.csv --reference 1 --monitor 'hpc.*' --exit-code -f ndjson
detect_parity: enginediag detect -n nominal.yaml series.csv --method parity
detect_bias: enginediag detect -n nominal.yaml bias.csv stuck.csv -f ndjson
detect_follow: cat series.csv | enginediag detect -n nominal.yaml --follow --window 20 -
detect_statistics: enginediag detect statistics.csv

# -- isolation
isolate: enginediag isolate -n nominal.yaml series.csv --picture isolate.svg
isolate_json: enginediag isolate -n nominal.yaml bias.csv -f json
isolate_statistics: enginediag isolate statistics.csv -f table --wide
isolate_components: enginediag isolate -n nominal.yaml series.csv --by component
isolate_advice: enginediag isolate -n nominal.yaml bias.csv --last 30 --advise -f ndjson
isolate_catalogue: enginediag isolate -n nominal.yaml series.csv --catalogue configs/faults/hpc_fouling.yaml --one-sided --no-flips
isolate_stuck: enginediag isolate -n nominal.yaml stuck.csv --no-work-scope
isolate_incremental: enginediag isolate statistics.csv --method incremental
isolate_sensitivity: enginediag isolate statistics.csv --method sensitivity
isolate_minmax: enginediag isolate -n nominal.yaml --no-sensors series.csv --method minmax --faults 2
isolate_nonlinear: enginediag isolate -n nominal.yaml series.csv --nonlinear always --no-sensors --no-flips -f ndjson

# -- over time
trend: enginediag trend -n nominal.yaml series.csv --picture trend.svg
trend_json: enginediag trend -n nominal.yaml bias.csv -f json
trend_components: enginediag trend -n nominal.yaml series.csv --by component -f table --wide
trend_flights: enginediag trend -n nominal.yaml series.csv --what flights
trend_margin: enginediag trend -n nominal.yaml series.csv --what margin --limit T45_K 1200
fleet_engines: for e in 1 2 3; do enginediag simulate configs/turbofan.yaml --flight configs/flights/snapshots.yaml --flights 24 --seed $e -q -o engine_$e.csv; done; sed 's/onset: 3/onset: 12/' configs/faults/hpc_fouling.yaml > fouling.yaml; enginediag simulate configs/turbofan.yaml --flight configs/flights/snapshots.yaml --fault fouling.yaml --flights 24 --seed 4 -q -o engine_4.csv
fleet: enginediag fleet configs/fleets/turbofans.yaml engine_*.csv --jobs 1 -o fleet.json
fleet_store: enginediag fleet configs/fleets/turbofans.yaml engine_*.csv --jobs 1 --store kept -f csv; enginediag fleet status configs/fleets/turbofans.yaml engine_*.csv --store kept; rm -r kept
fleet_health: enginediag fleet configs/fleets/turbofans.yaml engine_*.csv --jobs 1 --what health -f csv
report_fleet: enginediag report fleet.json --static -o fleet.html
report: enginediag report -n nominal.yaml series.csv --static -o report.html

# -- missing physics
truth: (cat configs/turbofan.yaml; printf '\nphysics:\n  - {term: reynolds_efficiency, at: hpc, coefficients: {exponent: 0.15}}\n') > truth.yaml
recorded: enginediag simulate truth.yaml --flight flights.yaml --flights 4 --seed 1 -q -o recorded.csv; enginediag simulate truth.yaml --flight flights.yaml --flights 4 --seed 2 -q -o unseen.csv
locate: enginediag locate configs/turbofan.yaml recorded.csv --picture locate.svg
locate_all: enginediag locate configs/turbofan.yaml recorded.csv --all -f json
explain: enginediag explain configs/turbofan.yaml recorded.csv -f json --curves curves.csv --plan plan.yaml
explain_null: enginediag explain configs/turbofan.yaml healthy.csv --no-advice
refine: enginediag refine configs/turbofan.yaml recorded.csv --term reynolds_efficiency@hpc --test unseen.csv --window 30 -o refined.yaml --report refined.csv --picture refine.svg

# -- studies and trials
study: enginediag study configs/studies/paper.yaml --repetitions 10 --processes 1 -q --columns case,method,detected,exact,contained
prove_null: enginediag prove --trials 1 --seed 5 --kind null --truth same_model --jobs 1 -f json -q
prove_isolate: enginediag prove --question isolate --trials 4 --seed 5 --truth realistic --jobs 1 -f csv -q

# -- files and help
check_engine: enginediag check configs/turbofan.yaml
check_recording: enginediag check -n nominal.yaml series.csv -f json
check_configs: enginediag check configs/faults/*.yaml configs/flights/*.yaml configs/recorders/*.yaml configs/fleets/*.yaml configs/studies/*.yaml
recorder: printf 'Time,ALT (ft),MACH,TAT (C),N1 (%%),EGT (C),FF (pph)\n00:00:01,1000,0.3,15,80,600,2000\n00:00:02,1100,0.31,14,81,602,2010\n00:00:03,1200,0.31,14,81,603,2020\n' > foreign.csv; enginediag recorder foreign.csv; enginediag recorder foreign.csv --engine configs/turbofan.yaml -o drafted.yaml
schema: enginediag schema; enginediag schema engine; enginediag schema fleet
schema_outputs: for o in detect isolate trend fleet explain locate residual; do enginediag schema output/$o; done
physics: enginediag physics -f csv; enginediag physics reynolds_efficiency; enginediag physics --engine configs/turbofan.yaml -f ndjson
components: enginediag components -f csv; enginediag components compressor

# -- what goes wrong
error_key: sed 's/^description:/descripton:/' configs/turbofan.yaml > misspelt.yaml; enginediag check misspelt.yaml
error_absent: enginediag detect -n nominal.yaml nowhere.csv
error_swapped: sed 's/N1_rpm/N3_rpm/; s/N2_rpm/N1_rpm/; s/N3_rpm/N2_rpm/' series.csv > swapped.csv; enginediag detect -n nominal.yaml swapped.csv
error_garbage: printf 'a;b\n\0\0x\n' > garbage.csv; enginediag isolate -n nominal.yaml garbage.csv
error_short: head -40 series.csv | enginediag detect -n nominal.yaml --window 1s - 2>&1 | tail -3
