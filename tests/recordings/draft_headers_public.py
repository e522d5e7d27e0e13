"""The headers of public formats. Those of TUNED were at hand when the grammar of names was written; those of FRESH were
written when it was finished."""

from __future__ import annotations

from draft_headers import AIRLINER, BENCH, PLANT, TURBOPROP, HeaderCase

TUNED = [
    HeaderCase(
        "airline snapshot reports",
        AIRLINER,
        """
REPORT DATE|clock|acars
ESN|text|
LEG|text|
RPT|text|CR
ALT KFT|altitude_m|kft
TAT F|TAT_K|degF
MN|mach|
N1 PCT|N1_rpm|pct
N2 PCT|N2_rpm|pct
EGT F|EGT_K|degF
FF PPH|Wf_kg_s|lb_h
PS3 PSI|Ps3_Pa|psi
""",
    ),
    HeaderCase(
        "ACMS A/B engines",
        AIRLINER,
        """
time_s|clock|seconds
ALT_STD (ft)|altitude_m|ft
MN|mach|
TAT (C)|TAT_K|degC
N1A (%RPM)|N1_rpm|pct
N2A (%RPM)|N2_rpm|pct
EGTA (DEG C)|EGT_K|degC
FFA (LB/HR)|Wf_kg_s|lb_h
N1B (%RPM)|N1_rpm|pct
N2B (%RPM)|N2_rpm|pct
EGTB (DEG C)|EGT_K|degC
FFB (LB/HR)|Wf_kg_s|lb_h
""",
    ),
    HeaderCase(
        "flight data analysis names",
        AIRLINER,
        """
time_s|clock|seconds
Altitude STD|altitude_m|(ft)
Mach|mach|
TAT|TAT_K|(degC)
SAT|ambient_temperature_K|(degC)
Airspeed|cas_m_s|(kt)
Eng (1) N1|N1_rpm|(pct)
Eng (1) N2|N2_rpm|(pct)
Eng (1) Gas Temp|EGT_K|(degC)
Eng (1) Fuel Flow|Wf_kg_s|(kg_h)
Eng (2) N1|N1_rpm|(pct)
Eng (2) N2|N2_rpm|(pct)
Eng (2) Gas Temp|EGT_K|(degC)
Eng (2) Fuel Flow|Wf_kg_s|(kg_h)
Eng (1) Oil Temp|-|
Eng (2) Oil Temp|-|
Eng (1) Vib N1|-|
Eng (2) Vib N1|-|
Heading|-|
Flap|-|
""",
    ),
    HeaderCase(
        "Garmin G1000, one PT6",
        TURBOPROP,
        """
Lcl Date|clock|date
Lcl Time|clock|time
UTCOfst|-|
AltP|altitude_m|ft
IAS|cas_m_s|kt
TAS|tas_m_s|kt
OAT|ambient_temperature_K|degC
AltMSL|-|
E1 FFlow|Wf_kg_s|gal_h
E1 Torq|torque_Nm|lbf_ft
E1 NP|N2_rpm|rpm
E1 NG|N1_rpm|pct
E1 ITT|ITT_K|degC
E1 OilT|-|
E1 OilP|-|
""",
        unit_row="yyy-mm-dd|hh:mm:ss|hh:mm|ft|kt|kt|deg C|ft msl|gph|ft-lb|rpm|%|deg C|deg F|psi",
    ),
    HeaderCase(
        "ProDiMES-like snapshots",
        AIRLINER,
        """
ESN|text|
Cycles|text|
Sensed_Altitude|altitude_m|(ft)
Sensed_Mach|mach|
Sensed_Pamb|ambient_pressure_Pa|(psi)
Sensed_Pt2|P2_Pa|(psi)
Sensed_TAT|TAT_K|(degR)
Sensed_WFuel|Wf_kg_s|(lb_s)
Sensed_Fan_Speed|N1_rpm|(rpm)
Sensed_Core_Speed|N2_rpm|(rpm)
Sensed_T25|T25_K|(degR)
Sensed_T3|T3_K|(degR)
Sensed_Ps3|Ps3_Pa|(psi)
Sensed_T45|T45_K|(degR)
""",
    ),
    HeaderCase(
        "N-CMAPSS",
        AIRLINER,
        """
unit|text|
cycle|text|
alt|altitude_m|(ft)
Mach|mach|
TRA|-|
T2|T2_K|(degR)
T24|T24_K|(degR)
T30|T3_K|(degR)
T48|T48_K|(degR)
T50|T5_K|(degR)
P15|P15_Pa|(psi)
P2|P2_Pa|(psi)
P21|P21_Pa|(psi)
P24|P24_Pa|(psi)
Ps30|Ps3_Pa|(psi)
P40|P4_Pa|(psi)
P50|P5_Pa|(psi)
Nf|N1_rpm|(rpm)
Nc|N2_rpm|(rpm)
Wf|Wf_kg_s|(lb_s)
""",
    ),
    HeaderCase(
        "C-MAPSS with sensor numbers",
        {**AIRLINER, "T2_K": 288.15, "T24_K": 357.0, "T3_K": 880.0, "P2_Pa": 101e3, "P15_Pa": 149e3},
        """
unit_nr|text|
time_cycles|text|
setting_1|altitude_m|(kft)
setting_2|mach|
setting_3|-|
s_1|T2_K|(degR)
s_2|T24_K|(degR)
s_3|T3_K|(degR)
s_4|T5_K|(degR)
s_5|P2_Pa|(psi)
s_6|P15_Pa|(psi)
s_7|P3_Pa|(psi)
s_8|N1_rpm|(rpm)
s_9|N2_rpm|(rpm)
s_10|EPR|
s_11|fuel_ratio_kg_s_Pa|(pph_psi)
s_12|Ps3_Pa|(psi)
s_13|-|
s_14|-|
s_15|BPR|
s_16|-|
s_17|-|
s_18|-|
s_19|-|
s_20|W31_kg_s|(lb_s)
s_21|W32_kg_s|(lb_s)
""",
    ),
    HeaderCase(
        "UCI gas turbine emissions",
        PLANT,
        """
AT|ambient_temperature_K|(degC)
AP|ambient_pressure_Pa|(mbar)
AH|relative_humidity|(pct)
AFDP|dP_inlet_Pa|(mbar)
GTEP|dP_exhaust_Pa|(mbar)
TIT|T4_K|(degC)
TAT|T5_K|(degC)
TEY|power_W|(MW)
CDP|P3_Pa|(bar)
CO|-|
NOX|-|
""",
    ),
    HeaderCase(
        "UCI naval plant",
        {**PLANT, "N1_rpm": 8800.0, "N2_rpm": 2600.0},
        """
lp|-|
v|-|
GTT|torque_Nm|(kNm)
GTn|N2_rpm|(rpm)
GGn|N1_rpm|(rpm)
Ts|-|
Tp|-|
T48|T45_K|(K)
T1|T2_K|(K)
T2|T3_K|(K)
P48|P45_Pa|(bar)
P1|P2_Pa|(bar)
P2|P3_Pa|(bar)
Pexh|P5_Pa|(bar)
TIC|-|
mf|Wf_kg_s|(kg_s)
kMc|-|
kMt|-|
""",
    ),
    HeaderCase(
        "GE Mark VI trend",
        PLANT,
        """
Time|clock|us
DWATT [MW]|power_W|MW
TNH [%]|N1_rpm|pct
TTXM [deg F]|T5_K|degF
CPD [psig]|P3_Pa|psig
CTD [deg F]|T3_K|degF
CTIM [deg F]|T2_K|degF
FQG [lb/s]|Wf_kg_s|lb_s
CSGV [deg]|-|
FSR [%]|-|
TTRF1 [deg F]|-|
AFPAP [inHg]|ambient_pressure_Pa|inHg
""",
    ),
    HeaderCase(
        "AMT Olympus bench",
        BENCH,
        """
Sample Number|-|
Throttle Position [%]|-|
Inlet Temperature T2(abs) [K]|T2_K|K
Compressor Entry Temperature T3 (abs) [K]|T3_K|K
Combustor Exit Total Temperature T4 (abs) [K]|T4_K|K
Turbine Exit Total Temperature T5 (abs) [K]|T5_K|K
Ambient Pressure P0 [kPa]|ambient_pressure_Pa|kPa
Abs Combustor Inlet Total Pressure P3 [kPa]|P3_Pa|kPa
Thrust Raw|-|
Thrust Offset|-|
Thrust T [N]|Fn_N|N
Speed n [rpm]|N1_rpm|rpm
Fuel Flow f [l/min]|Wf_kg_s|l_min
Upstream Density [kg/m³]|-|
""",
        delimiter=";",
    ),
    HeaderCase(
        "Cessna Citation flight test",
        AIRLINER,
        """
time_s|clock|seconds
altitude_ft|altitude_m|ft
mach|mach|
cas_kt|cas_m_s|kt
tas_kt|tas_m_s|kt
tat_degC|TAT_K|degC
sat_degC|ambient_temperature_K|degC
climb_ft_min|-|
lh_N1_pct|N1_rpm|pct
lh_N2_pct|N2_rpm|pct
lh_itt_degC|ITT_K|degC
lh_fuel_flow_lb_h|Wf_kg_s|lb_h
lh_fuel_used_lb|-|
rh_N1_pct|N1_rpm|pct
rh_N2_pct|N2_rpm|pct
rh_itt_degC|ITT_K|degC
rh_fuel_flow_lb_h|Wf_kg_s|lb_h
rh_fuel_used_lb|-|
""",
    ),
    HeaderCase(
        "helicopter HUMS",
        {**TURBOPROP, "N2_rpm": 20900.0, "N1_rpm": 44700.0},
        """
timestamp|clock|epoch
press_alt_ft|altitude_m|ft
ias_kts|cas_m_s|kt
oat_c|ambient_temperature_K|degC
ng_pct|N1_rpm|pct
np_pct|N2_rpm|pct
nr_pct|-|
mgt_c|EGT_K|degC
trq_measured_pct|torque_Nm|pct
wf_pph|Wf_kg_s|lb_h
""",
    ),
]
FRESH: list[HeaderCase] = []
