"""The headers of public formats. Those of TUNED were at hand when the grammar of names was written. Those of FRESH were
written when it was finished, and those of each further group after what the one before had shown was mended. Columns
right at first sight, and silently wrong: FRESH 230 of 264, 2; SECOND 143 of 154, 1; THIRD 71 of 78, 0; FOURTH 207 of
244, 0; FIFTH 131 of 151, 3; SIXTH 107 of 116, 0."""

from __future__ import annotations

from draft_headers import AIRLINER, BENCH, PLANT, TURBOPROP, HeaderCase

HELI = {**TURBOPROP, "N2_rpm": 20900.0, "N1_rpm": 44700.0}
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
        HELI,
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
FRESH = [
    HeaderCase(
        "Garmin G1000, two PT6",
        TURBOPROP,
        """
Lcl Date|clock|date
Lcl Time|clock|time
UTCOfst|-|
AtvWpt|-|
Latitude|-|
Longitude|-|
AltB|altitude_m|ft
BaroA|-|
AltMSL|-|
OAT|ambient_temperature_K|degC
IAS|cas_m_s|kt
GndSpd|-|
VSpd|-|
Pitch|-|
Roll|-|
volt1|-|
amp1|-|
FQtyL|-|
FQtyR|-|
E1 FFlow|Wf_kg_s|gal_h
E1 OilT|-|
E1 OilP|-|
E1 Torq|torque_Nm|lbf_ft
E1 NG|N1_rpm|pct
E1 ITT|ITT_K|degC
E2 FFlow|Wf_kg_s|gal_h
E2 OilT|-|
E2 OilP|-|
E2 Torq|torque_Nm|lbf_ft
E2 NG|N1_rpm|pct
E2 ITT|ITT_K|degC
TAS|tas_m_s|kt
WndSpd|-|
MagVar|-|
""",
        unit_row="yyy-mm-dd|hh:mm:ss|hh:mm|ident|degrees|degrees|ft Baro|inch|ft msl|deg C|kt|kt|fpm|deg|deg|volts|"
        "amps|gals|gals|gph|deg F|psi|ft-lb|%|deg C|gph|deg F|psi|ft-lb|%|deg C|kt|kt|deg",
    ),
    HeaderCase(
        "NASA sample flight data, four engines",
        AIRLINER,
        """
time|clock|seconds
ALT|altitude_m|(ft)
ALTR|-|
CAS|cas_m_s|(kt)
TAS|tas_m_s|(kt)
MACH|mach|
TAT|TAT_K|(degC)
SAT|ambient_temperature_K|(degC)
PSA|ambient_pressure_Pa|(mbar)
GS|-|
LATG|-|
FLAP|-|
N1.1|N1_rpm|(pct)
N1.2|N1_rpm|(pct)
N1.3|N1_rpm|(pct)
N1.4|N1_rpm|(pct)
N1C|-|
N1T|-|
N2.1|N2_rpm|(pct)
N2.2|N2_rpm|(pct)
N2.3|N2_rpm|(pct)
N2.4|N2_rpm|(pct)
EGT.1|EGT_K|(degC)
EGT.2|EGT_K|(degC)
EGT.3|EGT_K|(degC)
EGT.4|EGT_K|(degC)
FF.1|Wf_kg_s|(lb_h)
FF.2|Wf_kg_s|(lb_h)
FF.3|Wf_kg_s|(lb_h)
FF.4|Wf_kg_s|(lb_h)
OIP.1|-|
OIT.1|-|
PLA.1|-|
VIB.1|-|
FQTY.1|-|
""",
    ),
    HeaderCase(
        "quick access recorder with unit suffixes",
        AIRLINER,
        """
FLIGHT_TIME|clock|seconds
FLPL_AIRC_TYPE|-|
GRND_SPD_KT|-|
TRUE_AIR_SPD_KT|tas_m_s|kt
ALTI_STD_FT|altitude_m|ft
VERT_SPD_FTMN|-|
MASS_KG|-|
MACH_NR|mach|
FUEL_FLOW_KGH|Wf_kg_s|kg_h
TOT_AIR_TEMP_C|TAT_K|degC
""",
    ),
    HeaderCase(
        "LM2500 control system",
        {**PLANT, "N1_rpm": 9200.0, "N2_rpm": 3600.0, "P3_Pa": 1.8e6, "Ps3_Pa": 1.8e6, "T3_K": 720.0, "T48_K": 1060.0},
        """
time|clock|iso
T1_NGGSEL|N1_rpm|(rpm)
T1_NPTSEL|N2_rpm|(rpm)
T1_T2SEL|T2_K|(degC)
T1_P2SEL|P2_Pa|(kPa)
T1_T3SEL|T3_K|(degC)
T1_PS3SEL|Ps3_Pa|(kPa)
T1_T48SEL|T48_K|(degC)
T1_DWATT|power_W|(MW)
T1_IGVSEL|-|
T1_VSVSEL|-|
""",
    ),
    HeaderCase(
        "QAR of a twin, A320 style",
        AIRLINER,
        """
TIME|clock|time
ALT_STD|altitude_m|(ft)
CAS|cas_m_s|(kt)
MACH|mach|
SAT|ambient_temperature_K|(degC)
TAT|TAT_K|(degC)
N11|N1_rpm|(pct)
N12|N1_rpm|(pct)
N21|N2_rpm|(pct)
N22|N2_rpm|(pct)
EGT1|EGT_K|(degC)
EGT2|EGT_K|(degC)
FF1|Wf_kg_s|(kg_h)
FF2|Wf_kg_s|(kg_h)
VIB_N11|-|
VIB_N12|-|
OIL_TMP1|-|
OIL_PRS1|-|
FLIGHT_PHASE|text|CR
PACK1_FLOW|-|
WING_AI|-|
""",
    ),
    HeaderCase(
        "PT6A trend sheet",
        TURBOPROP,
        """
Date|clock|date
Hobbs|-|
Press Alt (ft)|altitude_m|ft
OAT (C)|ambient_temperature_K|degC
IAS (kts)|cas_m_s|kt
Torque (ft-lb)|torque_Nm|lbf_ft
Np (rpm)|N2_rpm|rpm
Ng (%)|N1_rpm|pct
ITT (C)|ITT_K|degC
Wf (pph)|Wf_kg_s|lb_h
Oil Temp (C)|-|
Oil Press (psi)|-|
Initials|-|
""",
    ),
    HeaderCase(
        "helicopter, two engines in words",
        HELI,
        """
UTC|clock|iso
Pressure Altitude (ft)|altitude_m|ft
Indicated Airspeed (kt)|cas_m_s|kt
Outside Air Temperature (degC)|ambient_temperature_K|degC
Main Rotor Speed (%)|-|
Engine 1 Gas Generator Speed (%)|N1_rpm|pct
Engine 2 Gas Generator Speed (%)|N1_rpm|pct
Engine 1 Power Turbine Speed (%)|N2_rpm|pct
Engine 2 Power Turbine Speed (%)|N2_rpm|pct
Engine 1 Torque (%)|torque_Nm|pct
Engine 2 Torque (%)|torque_Nm|pct
Engine 1 TOT (degC)|EGT_K|degC
Engine 2 TOT (degC)|EGT_K|degC
Engine 1 Fuel Flow (kg/h)|Wf_kg_s|kg_h
Engine 2 Fuel Flow (kg/h)|Wf_kg_s|kg_h
Engine 1 Oil Pressure (bar)|-|
Engine 2 Oil Pressure (bar)|-|
Main Gearbox Oil Temperature (degC)|-|
""",
        delimiter="\t",
    ),
    HeaderCase(
        "large three-spool turbofan, snapshots",
        {**AIRLINER, "N1_rpm": 2600.0, "N2_rpm": 7000.0, "N3_rpm": 10500.0},
        """
Tail No|-|
Flt No|text|
Date Time|clock|eu
P0 (psia)|ambient_pressure_Pa|psi
T20 (K)|T2_K|K
P20 (psia)|P2_Pa|psi
N1 (%)|N1_rpm|pct
N2 (%)|N2_rpm|pct
N3 (%)|N3_rpm|pct
TGT (degC)|EGT_K|degC
P25 (psia)|P25_Pa|psi
T25 (K)|T25_K|K
P30 (psia)|P3_Pa|psi
T30 (K)|T3_K|K
FF (lb/hr)|Wf_kg_s|lb_h
EPR|EPR|
Oil Press (psi)|-|
Vib N1 (ips)|-|
""",
    ),
    HeaderCase(
        "cycle deck output",
        AIRLINER,
        """
MN|mach|
alt|altitude_m|(ft)
W2|W2_kg_s|(lb_s)
T2|T2_K|(degR)
P2|P2_Pa|(psi)
T25|T25_K|(degR)
P25|P25_Pa|(psi)
T3|T3_K|(degR)
P3|P3_Pa|(psi)
T4|T4_K|(degR)
T45|T45_K|(degR)
P45|P45_Pa|(psi)
T5|T5_K|(degR)
P5|P5_Pa|(psi)
WF|Wf_kg_s|(lb_s)
FN|Fn_N|(lbf)
FG|Fg_N|(lbf)
TSFC|-|
OPR|-|
BPR|BPR|
XN_LP|N1_rpm|(rpm)
XN_HP|N2_rpm|(rpm)
HPC_eff|-|
LPT_PR|-|
""",
    ),
    HeaderCase(
        "plant historian tags, frame machine",
        PLANT,
        """
Timestamp|clock|iso
GT1.DWATT.PV|power_W|(MW)
GT1.TNH.PV|N1_rpm|(pct)
GT1.TTXM.PV|T5_K|(degC)
GT1.CTD.PV|T3_K|(degC)
GT1.CTIM.PV|T2_K|(degC)
GT1.CPD.PV|P3_Pa|(barg)
GT1.FQG.PV|Wf_kg_s|(kg_s)
GT1.AMB_TEMP.PV|ambient_temperature_K|(degC)
GT1.AMB_PRESS.PV|ambient_pressure_Pa|(mbar)
GT1.REL_HUM.PV|relative_humidity|(pct)
GT1.IGV_ANGLE.PV|-|
GT1.LUBE_OIL_TEMP.PV|-|
GT1.BRG1_VIB.PV|-|
GT1.INLET_DP.PV|dP_inlet_Pa|(mbar)
""",
    ),
    HeaderCase(
        "industrial two-shaft machine",
        {**PLANT, "N1_rpm": 14300.0, "N2_rpm": 13800.0, "power_W": 5.0e6, "T5_K": 780.0, "Wf_kg_s": 0.4},
        """
DateTime|clock|us
NGP (%)|N1_rpm|pct
NPT (%)|N2_rpm|pct
T5 Avg (degF)|T5_K|degF
T5 TC1 (degF)|-|
PCD (psig)|P3_Pa|psig
T1 (degF)|T1_K|degF
Ambient Temp (degF)|ambient_temperature_K|degF
Barometric Pressure (psia)|ambient_pressure_Pa|psi
Fuel Flow (lb/hr)|Wf_kg_s|lb_h
Output Power (kW)|power_W|kW
Lube Oil Header Pressure (psig)|-|
Guide Vane Position (deg)|-|
Fuel Valve Command (%)|-|
""",
    ),
    HeaderCase(
        "micro turbojet controller",
        {**BENCH, "N1_rpm": 96000.0},
        """
Time (s)|clock|seconds
RPM|N1_rpm|(rpm)
EGT (C)|EGT_K|degC
Pump Voltage|-|
Throttle (%)|-|
Battery (V)|-|
Ambient Temp (C)|ambient_temperature_K|degC
Ambient Press (kPa)|ambient_pressure_Pa|kPa
Thrust (kgf)|Fn_N|kgf
Fuel Flow (g/s)|Wf_kg_s|g_s
""",
    ),
    HeaderCase(
        "test cell, German",
        BENCH,
        """
Datum|clock|date
Uhrzeit|clock|time
Drehzahl [1/min]|N1_rpm|rpm
Kraftstoff Durchfluss [kg/h]|Wf_kg_s|kg_h
Umgebungsdruck [mbar]|ambient_pressure_Pa|mbar
Umgebungstemperatur [°C]|ambient_temperature_K|degC
T3 [°C]|T3_K|degC
P3 [bar]|P3_Pa|bar
Abgastemperatur [°C]|EGT_K|degC
Schub [N]|Fn_N|N
Öltemperatur [°C]|-|
""",
        delimiter=";",
    ),
    HeaderCase(
        "business jet FADEC download",
        AIRLINER,
        """
Elapsed Time (sec)|clock|seconds
Flight Number|text|
LEFT N1 (%)|N1_rpm|pct
RIGHT N1 (%)|N1_rpm|pct
LEFT N2 (%)|N2_rpm|pct
RIGHT N2 (%)|N2_rpm|pct
LEFT ITT (Deg C)|ITT_K|degC
RIGHT ITT (Deg C)|ITT_K|degC
LEFT FUEL FLOW (PPH)|Wf_kg_s|lb_h
RIGHT FUEL FLOW (PPH)|Wf_kg_s|lb_h
LEFT OIL PRESS (PSI)|-|
RIGHT OIL PRESS (PSI)|-|
LEFT TLA (DEG)|-|
RIGHT TLA (DEG)|-|
PRESSURE ALTITUDE (FT)|altitude_m|ft
MACH NUMBER|mach|
TOTAL AIR TEMP (DEG C)|TAT_K|degC
STATIC AIR TEMP (DEG C)|ambient_temperature_K|degC
N1 TARGET (%)|-|
""",
    ),
    HeaderCase(
        "full authority control bus, two channels",
        AIRLINER,
        """
time_ms|clock|
EEC_A_N1_RPM|N1_rpm|rpm
EEC_B_N1_RPM|N1_rpm|rpm
EEC_A_T25_DEGC|T25_K|degC
EEC_B_T25_DEGC|T25_K|degC
EEC_A_T3_DEGC|T3_K|degC
EEC_A_PS3_PSIA|Ps3_Pa|psi
EEC_A_WF_PPH|Wf_kg_s|lb_h
EEC_A_EGT_DEGC|EGT_K|degC
EEC_A_VSV_POS_DEG|-|
EEC_A_N1_CMD_RPM|-|
""",
        clock="seconds",
    ),
]
SECOND = [
    HeaderCase(
        "SCADA export of a plant",
        PLANT,
        """
timestamp|clock|iso
ambient_temp_c|ambient_temperature_K|degC
rel_humidity_pct|relative_humidity|pct
compressor_inlet_pressure_bar|P2_Pa|bar
compressor_discharge_pressure_bar|P3_Pa|bar
compressor_discharge_temp_c|T3_K|degC
turbine_inlet_temp_c|T4_K|degC
exhaust_temp_c|EGT_K|degC
fuel_flow_kg_s|Wf_kg_s|kg_s
bearing_vibration_mms|-|
bearing_temp_c|-|
shaft_speed_rpm|N1_rpm|rpm
gross_output_mw|power_W|MW
isentropic_efficiency_pct|-|
""",
    ),
    HeaderCase(
        "C-MAPSS with names in words",
        {**AIRLINER, "T2_K": 288.15, "T24_K": 357.0, "T3_K": 880.0, "P2_Pa": 101e3, "P15_Pa": 149e3},
        """
unit|text|
time|-|cycles
Total temperature at fan inlet|T2_K|(degR)
Total temperature at LPC outlet|T24_K|(degR)
Total temperature at HPC outlet|T3_K|(degR)
Total temperature at LPT outlet|T5_K|(degR)
Pressure at fan inlet|P2_Pa|(psi)
Total pressure in bypass-duct|-|
Total pressure at HPC outlet|P3_Pa|(psi)
Physical fan speed|N1_rpm|(rpm)
Physical core speed|N2_rpm|(rpm)
Engine pressure ratio|EPR|
Static pressure at HPC outlet|Ps3_Pa|(psi)
Ratio of fuel flow to Ps30|-|
Corrected fan speed|-|
Corrected core speed|-|
Bypass-ratio|BPR|
Burner fuel-air ratio|-|
Bleed Enthalpy|-|
Demanded fan speed|-|
HPT coolant bleed|-|
""",
    ),
    HeaderCase(
        "telemetry database",
        PLANT,
        """
turbine_id|-|
sample_time|clock|iso
operating_hours|-|
speed_rpm|N1_rpm|rpm
speed_target_rpm|-|
egt_celsius|EGT_K|degC
oil_temp_celsius|-|
fuel_flow_kg_s|Wf_kg_s|kg_s
compressor_discharge_temp_celsius|T3_K|degC
compressor_discharge_pressure_kpa|P3_Pa|kPa
efficiency_fraction|-|
ambient_temp_celsius|ambient_temperature_K|degC
ambient_pressure_kpa|ambient_pressure_Pa|kPa
vibration_rms_mm_s|-|
""",
    ),
    HeaderCase(
        "trainer aircraft, two engines",
        AIRLINER,
        """
time_sec|clock|seconds
phase|text|CR
n1_pct_l|N1_rpm|pct
n1_pct_r|N1_rpm|pct
egt_l|EGT_K|(degC)
egt_r|EGT_K|(degC)
fuel_qty|-|
fuel_flow_l|Wf_kg_s|(kg_h)
fuel_flow_r|Wf_kg_s|(kg_h)
n1_l_state|-|
n1_r_state|-|
egt_l_state|-|
egt_r_state|-|
""",
    ),
    HeaderCase(
        "fighter, names without spaces",
        {**AIRLINER, "altitude_m": 6000.0, "ambient_temperature_K": 249.0, "TAT_K": 279.0},
        """
Time|clock|seconds
LeftMachNum|-|
LeftFanSpeed [rpm]|N1_rpm|rpm
RightFanSpeed [rpm]|N1_rpm|rpm
LeftCoreSpeed [rpm]|N2_rpm|rpm
RightCoreSpeed [rpm]|N2_rpm|rpm
LeftFanTurbineInletTemp [C]|T45_K|degC
RightFanTurbineInletTemp [C]|T45_K|degC
LeftCoreFuelFlow [pph]|Wf_kg_s|lb_h
RightCoreFuelFlow [pph]|Wf_kg_s|lb_h
LeftMainOilPressure [psi]|-|
RightMainOilPressure [psi]|-|
LeftNozzlePosition [%]|-|
RightNozzlePosition [%]|-|
LeftPowerLeverAngle [deg]|-|
RightPowerLeverAngle [deg]|-|
""",
    ),
    HeaderCase(
        "camel-case service",
        {**AIRLINER, "altitude_m": 3000.0, "mach": 0.5, "ambient_temperature_K": 270.0},
        """
altitude|altitude_m|(ft)
machNumber|mach|
ambientTemp|ambient_temperature_K|(degC)
compressorInletTemp|T2_K|(degC)
compressorOutletTemp|T3_K|(degC)
turbineInletTemp|T4_K|(degC)
turbineOutletTemp|T5_K|(degC)
bleedAirTemp|-|
bypassRatio|BPR|
fuelFlow|Wf_kg_s|(kg_h)
oilTemperature|-|
bearingTemperature|-|
throttlePosition|-|
fuelPressure|-|
vibrationX|-|
""",
    ),
    HeaderCase(
        "simulator, columns apart by bars",
        AIRLINER,
        """
_totl,_time|clock|seconds
Vind,_kias|cas_m_s|(kt)
Vtrue,_ktas|tas_m_s|(kt)
Mach,ratio|mach|
N1__1,_pcnt|N1_rpm|pct
N1__2,_pcnt|N1_rpm|pct
N2__1,_pcnt|N2_rpm|pct
N2__2,_pcnt|N2_rpm|pct
EGT_1,__deg|-|
FF__1,_lb/h|Wf_kg_s|lb_h
FF__2,_lb/h|Wf_kg_s|lb_h
pitch,__deg|-|
""",
        delimiter="|",
    ),
    HeaderCase(
        "aeroderivative on site",
        {**PLANT, "N1_rpm": 3600.0, "N2_rpm": 10200.0, "T25_K": 380.0, "P25_Pa": 2.3e5, "P3_Pa": 2.6e6, "Ps3_Pa": 2.6e6}
        | {"T3_K": 800.0, "T48_K": 1100.0, "power_W": 4.2e7, "Wf_kg_s": 2.4},
        """
Date|clock|date
Time|clock|time
XN2 (rpm)|N1_rpm|rpm
XN25 (rpm)|N2_rpm|rpm
T2 (degF)|T2_K|degF
P2 (psia)|P2_Pa|psi
T25 (degF)|T25_K|degF
P25 (psia)|P25_Pa|psi
T3 (degF)|T3_K|degF
PS3 (psia)|Ps3_Pa|psi
T48 (degF)|T48_K|degF
MW (MW)|power_W|MW
Gas Fuel Flow (lb/hr)|Wf_kg_s|lb_h
NOx Water Flow (gpm)|-|
VIGV Position (%)|-|
VSV Position (%)|-|
GEN VIB (mils)|-|
""",
    ),
    HeaderCase(
        "turboprop engine data sheet",
        {**TURBOPROP, "N3_rpm": 20000.0, "N1_rpm": 27000.0, "N2_rpm": 31000.0},
        """
A/C Reg|-|
Flight No.|text|
UTC Date|clock|date
UTC Time|clock|time
PALT FT|altitude_m|ft
IAS KT|cas_m_s|kt
SAT DEG C|ambient_temperature_K|degC
NH1 %|N2_rpm|pct
NH2 %|N2_rpm|pct
NL1 %|N1_rpm|pct
NL2 %|N1_rpm|pct
NP1 %|N3_rpm|pct
NP2 %|N3_rpm|pct
TQ1 %|torque_Nm|pct
TQ2 %|torque_Nm|pct
ITT1 DEG C|ITT_K|degC
ITT2 DEG C|ITT_K|degC
FF1 KG/H|Wf_kg_s|kg_h
FF2 KG/H|Wf_kg_s|kg_h
""",
    ),
    HeaderCase(
        "small helicopter, one engine",
        {**TURBOPROP, "N2_rpm": 33000.0, "N1_rpm": 50000.0},
        """
Timestamp|clock|us
OAT [°C]|ambient_temperature_K|degC
Zp [ft]|altitude_m|ft
N1 [%]|N1_rpm|pct
N2 [%]|N2_rpm|pct
NR [%]|-|
TOT [°C]|EGT_K|degC
TQ [%]|torque_Nm|pct
FF [l/h]|Wf_kg_s|l_h
ENG OT [°C]|-|
ENG OP [bar]|-|
XMSN OP [bar]|-|
FUEL PRESS [bar]|-|
""",
    ),
]
THIRD = [
    HeaderCase(
        "EHM take-off and climb report",
        AIRLINER,
        """
AIRCRAFT ID|-|
ENGINE SERIAL NO|text|
ENGINE POS|-|
FLIGHT DATE|clock|date
FLIGHT TIME|clock|time
PRESSURE ALT (FT)|altitude_m|ft
MACH NO|mach|
TAT (DEG C)|TAT_K|degC
N1 ACTUAL (%)|N1_rpm|pct
N2 ACTUAL (%)|N2_rpm|pct
EGT ACTUAL (DEG C)|EGT_K|degC
FUEL FLOW (LBS/HR)|Wf_kg_s|lb_h
CDP (PSIA)|P3_Pa|psi
T25 (DEG C)|T25_K|degC
VSV POS (DEG)|-|
VBV POS (DEG)|-|
N1 VIB (MILS)|-|
OIL TEMP (DEG C)|-|
EGT MARGIN|-|
""",
    ),
    HeaderCase(
        "pyCycle viewer",
        AIRLINER,
        """
fc.alt|altitude_m|(ft)
fc.MN|mach|
fc.W|-|
inlet.Fl_O.T|-|
HPC.Fl_O.tot.T|-|
HP_Nmech|N2_rpm|(rpm)
LP_Nmech|N1_rpm|(rpm)
perf.Fn|Fn_N|(lbf)
perf.OPR|-|
perf.TSFC|-|
""",
    ),
    HeaderCase(
        "power plant DCS, long names",
        PLANT,
        """
Date Time|clock|eu
Gas Turbine Active Power [MW]|power_W|MW
Gas Turbine Speed [rpm]|N1_rpm|rpm
Compressor Inlet Temperature [°C]|T2_K|degC
Compressor Inlet Pressure [mbar]|P2_Pa|mbar
Compressor Outlet Temperature [°C]|T3_K|degC
Compressor Outlet Pressure [bar(g)]|P3_Pa|barg
Turbine Outlet Temperature [°C]|T5_K|degC
Fuel Gas Mass Flow [kg/s]|Wf_kg_s|kg_s
Ambient Temperature [°C]|ambient_temperature_K|degC
Ambient Pressure [hPa]|ambient_pressure_Pa|hPa
Relative Humidity [%]|relative_humidity|pct
IGV Position [%]|-|
Lube Oil Supply Temperature [°C]|-|
Generator Reactive Power [MVAr]|-|
Exhaust NOx [mg/Nm3]|-|
Inlet Filter Differential Pressure [mbar]|dP_inlet_Pa|mbar
""",
        delimiter=";",
    ),
    HeaderCase(
        "ARINC 429 decoder output",
        AIRLINER,
        """
UTC|clock|iso
Standard Altitude|altitude_m|(ft)
Computed Airspeed|cas_m_s|(kt)
Mach|mach|
True Airspeed|tas_m_s|(kt)
Total Air Temperature|TAT_K|(degC)
Static Air Temperature|ambient_temperature_K|(degC)
Eng1 N1 Actual|N1_rpm|(pct)
Eng2 N1 Actual|N1_rpm|(pct)
Eng1 N1 Command|-|
Eng2 N1 Command|-|
Eng1 N2|N2_rpm|(pct)
Eng2 N2|N2_rpm|(pct)
Eng1 EGT|EGT_K|(degC)
Eng2 EGT|EGT_K|(degC)
Eng1 Fuel Flow|Wf_kg_s|(kg_h)
Eng2 Fuel Flow|Wf_kg_s|(kg_h)
Eng1 Throttle Resolver Angle|-|
Eng2 Throttle Resolver Angle|-|
Altitude Rate|-|
""",
    ),
    HeaderCase(
        "microturbine skid",
        {**BENCH, "T35_K": 780.0, "T6_K": 550.0},
        """
t_s|clock|seconds
n_rpm|N1_rpm|rpm
P_el_kW|power_W|kW
T_amb_C|ambient_temperature_K|degC
p_amb_mbar|ambient_pressure_Pa|mbar
T2_C|T2_K|degC
T3_C|T3_K|degC
p3_bar|P3_Pa|bar
T5_C|T5_K|degC
m_fuel_g_s|Wf_kg_s|g_s
RH_pct|relative_humidity|pct
valve_pct|-|
""",
    ),
]
FOURTH = [
    HeaderCase(
        "Garmin G3X, turboprop",
        TURBOPROP,
        """
Date (yyyy-mm-dd)|clock|date
Time (hh:mm:ss)|clock|time
UTC Time (hh:mm:ss)|-|
GPS Altitude (ft)|-|
GPS Ground Speed (kt)|-|
Pressure Altitude (ft)|altitude_m|ft
Baro Altitude (ft)|-|
Indicated Airspeed (kt)|cas_m_s|kt
True Airspeed (kt)|tas_m_s|kt
OAT (deg C)|ambient_temperature_K|degC
NG (%)|N1_rpm|pct
Prop RPM|N2_rpm|rpm
Torque (ft-lb)|torque_Nm|lbf_ft
ITT (deg C)|ITT_K|degC
Fuel Flow (gal/hour)|Wf_kg_s|gal_h
Fuel Press (PSI)|-|
Oil Temp (deg F)|-|
Volts|-|
""",
    ),
    HeaderCase(
        "Avidyne engine page, turboprop",
        TURBOPROP,
        """
TIME|clock|time
DATE|clock|date
LAT|-|
LON|-|
PALT|altitude_m|(ft)
DALT|-|
IAS|cas_m_s|(kt)
TAS|tas_m_s|(kt)
OAT|ambient_temperature_K|(degC)
TRQ|torque_Nm|(lbf_ft)
ITT|ITT_K|(degC)
NP|N2_rpm|(rpm)
NG|N1_rpm|(pct)
FF|Wf_kg_s|(gal_h)
OILT|-|
OILP|-|
MBUS|-|
""",
    ),
    HeaderCase(
        "Dynon SkyView, turbine",
        TURBOPROP,
        """
Session Time|clock|seconds
Pressure Altitude (ft)|altitude_m|ft
Indicated Airspeed (knots)|cas_m_s|kt
True Airspeed (knots)|tas_m_s|kt
OAT (deg C)|ambient_temperature_K|degC
Density Altitude (ft)|-|
RPM L|N2_rpm|rpm
N1 (%)|N1_rpm|pct
Fuel Flow 1 (gal/hr)|Wf_kg_s|gal_h
Oil Temp (deg C)|-|
Torque (ft-lbs)|torque_Nm|lbf_ft
ITT (deg C)|ITT_K|degC
Percent Power|-|
Vertical Speed (ft/min)|-|
Wind Speed (knots)|-|
""",
    ),
    HeaderCase(
        "cruise report, narrow-body, CFM style",
        AIRLINER,
        """
ACID|-|
DATE|clock|date
UTC|clock|time
FLT|text|
ZALT|altitude_m|(ft)
ZXM|mach|
ZT1A|TAT_K|(degC)
ZN1|N1_rpm|(pct)
ZN2|N2_rpm|(pct)
ZEGT|EGT_K|(degC)
ZWF36|Wf_kg_s|(lb_h)
ZPS3|Ps3_Pa|(psi)
ZT25|T25_K|(degC)
ZT3|T3_K|(degC)
ZVB1F|-|
ZPOIL|-|
""",
    ),
    HeaderCase(
        "stable cruise, wide-body, PW style",
        {**AIRLINER, "EPR": 1.38},
        """
Tail|-|
Flight|text|
Date/Time (UTC)|clock|iso
Press Alt [ft]|altitude_m|ft
Mach No.|mach|
TAT [degC]|TAT_K|degC
EPR-L|EPR|
EPR-R|EPR|
N1-L [%]|N1_rpm|pct
N1-R [%]|N1_rpm|pct
N2-L [%]|N2_rpm|pct
N2-R [%]|N2_rpm|pct
EGT-L [degC]|EGT_K|degC
EGT-R [degC]|EGT_K|degC
FF-L [lb/hr]|Wf_kg_s|lb_h
FF-R [lb/hr]|Wf_kg_s|lb_h
T2.6-L [degC]|-|
Oil Qty-L [qt]|-|
""",
    ),
    HeaderCase(
        "Mark VIe live data, two-shaft",
        {**PLANT, "N1_rpm": 7100.0, "N2_rpm": 4670.0},
        """
Time Stamp|clock|iso
G1\\ATID|T2_K|(degC)
G1\\AFPAP|ambient_pressure_Pa|(inHg)
G1\\TNH|N1_rpm|(pct)
G1\\TNL|N2_rpm|(pct)
G1\\CTDA1|-|
G1\\CTD|T3_K|(degC)
G1\\CPD|P3_Pa|(kPa)
G1\\TTXM|T5_K|(degC)
G1\\TTRF1|-|
G1\\FQG|Wf_kg_s|(kg_s)
G1\\DWATT|power_W|(MW)
G1\\DVAR|-|
G1\\CSGV|-|
G1\\BB_MAX|-|
""",
    ),
    HeaderCase(
        "OPC UA node names",
        PLANT,
        """
SourceTimestamp|clock|iso
ns=2;s=GT11.Compressor.InletTemperature_degC|T2_K|degC
ns=2;s=GT11.Compressor.InletPressure_mbar|P2_Pa|mbar
ns=2;s=GT11.Compressor.DischargeTemperature_degC|T3_K|degC
ns=2;s=GT11.Compressor.DischargePressure_bar|P3_Pa|bar
ns=2;s=GT11.Turbine.ExhaustTemperature_degC|EGT_K|degC
ns=2;s=GT11.Turbine.Speed_rpm|N1_rpm|rpm
ns=2;s=GT11.Generator.ActivePower_MW|power_W|MW
ns=2;s=GT11.Generator.ReactivePower_MVAr|-|
ns=2;s=GT11.Fuel.MassFlow_kg_s|Wf_kg_s|kg_s
ns=2;s=GT11.Fuel.Temperature_degC|-|
ns=2;s=GT11.Ambient.Temperature_degC|ambient_temperature_K|degC
ns=2;s=GT11.Ambient.Humidity_pct|relative_humidity|pct
ns=2;s=GT11.IGV.Position_pct|-|
""",
        delimiter="\t",
    ),
    HeaderCase(
        "PI historian, KKS tags",
        PLANT,
        """
Time|clock|us
11MBA01CS901 TURBINE SPEED [rpm]|N1_rpm|rpm
11MBA11CT900 COMPR OUTLET TEMP [degC]|T3_K|degC
11MBA11CP901 COMPR OUTLET PRESS [bar]|P3_Pa|bar
11MBL01CT901 COMPR INLET TEMP [degC]|T2_K|degC
11MBA26CT900 TURB OUTLET TEMP CORR [degC]|-|
11MBA26CT901 TURB OUTLET TEMP [degC]|T5_K|degC
11MBP01CF901 FUEL GAS MASS FLOW [kg/s]|Wf_kg_s|kg_s
11MKA01CE901 GEN ACTIVE POWER [MW]|power_W|MW
11MBL01CP001 AIR INTAKE FILTER DIFF PRESS [mbar]|-|
11CXA01CT001 AMBIENT TEMP [degC]|ambient_temperature_K|degC
11CXA01CM001 AMBIENT REL HUMIDITY [%]|relative_humidity|pct
11CXA01CP001 AMBIENT PRESS [mbar]|ambient_pressure_Pa|mbar
11MBA01CY001 SHAFT VIB [mm/s]|-|
""",
    ),
    HeaderCase(
        "N-CMAPSS in a data frame",
        AIRLINER,
        """
unit|text|
cycle|text|
Fc|-|
hs|-|
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
P24|P24_Pa|(psi)
Ps30|Ps3_Pa|(psi)
P50|P5_Pa|(psi)
Nf|N1_rpm|(rpm)
Nc|N2_rpm|(rpm)
Wf|Wf_kg_s|(lb_s)
SmFan|-|
phi|-|
""",
    ),
    HeaderCase(
        "regional jet, FDR parameters",
        AIRLINER,
        """
Time (sec)|clock|seconds
Pressure Altitude Coarse (ft)|altitude_m|ft
Computed Airspeed (kt)|cas_m_s|kt
Mach Number|mach|
Total Air Temperature (deg C)|TAT_K|degC
Engine 1 Fan Speed N1 (%)|N1_rpm|pct
Engine 2 Fan Speed N1 (%)|N1_rpm|pct
Engine 1 Core Speed N2 (%)|N2_rpm|pct
Engine 2 Core Speed N2 (%)|N2_rpm|pct
Engine 1 ITT (deg C)|ITT_K|degC
Engine 2 ITT (deg C)|ITT_K|degC
Engine 1 Fuel Flow (lb/h)|Wf_kg_s|lb_h
Engine 2 Fuel Flow (lb/h)|Wf_kg_s|lb_h
Engine 1 Throttle Lever Angle (deg)|-|
Engine 2 Throttle Lever Angle (deg)|-|
Engine 1 Fan Vibration (mil)|-|
Left Bleed Valve|-|
Autothrottle Engaged|-|
""",
    ),
    HeaderCase(
        "helicopter usage file, two engines",
        HELI,
        """
Elapsed_Time_s|clock|seconds
Baro_Pressure_Alt_ft|altitude_m|ft
Airspeed_Ind_kts|cas_m_s|kt
OAT_degC|ambient_temperature_K|degC
Eng1_NG_pct|N1_rpm|pct
Eng1_NP_pct|N2_rpm|pct
Eng1_TGT_degC|EGT_K|degC
Eng1_TRQ_pct|torque_Nm|pct
Eng1_FuelFlow_lbhr|Wf_kg_s|lb_h
Eng1_OilPress_psi|-|
Eng2_NG_pct|N1_rpm|pct
Eng2_NP_pct|N2_rpm|pct
Eng2_TGT_degC|EGT_K|degC
Eng2_TRQ_pct|torque_Nm|pct
Eng2_FuelFlow_lbhr|Wf_kg_s|lb_h
Eng2_OilPress_psi|-|
Main_Rotor_NR_pct|-|
Collective_pct|-|
""",
    ),
    HeaderCase(
        "marine LM2500, machinery control",
        {**PLANT, "N1_rpm": 9200.0, "N2_rpm": 3500.0, "P3_Pa": 1.8e6, "T3_K": 720.0, "T45_K": 1060.0},
        """
LogTime|clock|iso
GTM 1A GAS GEN SPEED (RPM)|N1_rpm|rpm
GTM 1A PWR TURB SPEED (RPM)|N2_rpm|rpm
GTM 1A COMP INLET TEMP (DEGF)|T2_K|degF
GTM 1A COMP INLET TOTAL PRESS (PSIA)|P2_Pa|psi
GTM 1A COMP DISCH PRESS (PSIG)|P3_Pa|psig
GTM 1A PWR TURB INLET TEMP (DEGF)|T45_K|degF
GTM 1A PWR TURB INLET PRESS (PSIA)|P45_Pa|psi
GTM 1A FUEL MANIFOLD PRESS (PSIG)|-|
GTM 1A LUBE OIL SUPPLY PRESS (PSIG)|-|
GTM 1A GG VIBRATION (MILS)|-|
GTM 1A TORQUE (KFT-LB)|-|
GTM 1A MODULE COOLING AIR OUT TEMP (DEGF)|-|
SHAFT SPEED (RPM)|-|
""",
    ),
    HeaderCase(
        "acceptance test, ISO 2314 sheet",
        PLANT,
        """
Reading No.|-|cycles
Barometric pressure pa [kPa]|ambient_pressure_Pa|kPa
Ambient air temperature ta [°C]|ambient_temperature_K|degC
Relative humidity [%]|relative_humidity|pct
Compressor inlet total temperature Tt1 [°C]|T1_K|degC
Inlet pressure loss [Pa]|dP_inlet_Pa|Pa
Exhaust pressure loss [Pa]|dP_exhaust_Pa|Pa
Compressor outlet pressure p2 [kPa]|P3_Pa|kPa
Fuel mass flow [kg/s]|Wf_kg_s|kg_s
Lower heating value [kJ/kg]|-|
Generator terminal power [kW]|power_W|kW
Turbine exhaust temperature [°C]|EGT_K|degC
Shaft speed [min-1]|N1_rpm|rpm
Heat rate [kJ/kWh]|-|
Thermal efficiency [%]|-|
""",
        delimiter=";",
    ),
    HeaderCase(
        "gas turbine test cell, dyno",
        {**BENCH, "N1_rpm": 44700.0, "N2_rpm": 20900.0},
        """
Point|-|cycles
Clock|clock|time
Pamb_kPa|ambient_pressure_Pa|kPa
Tamb_degC|ambient_temperature_K|degC
T1_avg_degC|T1_K|degC
Ps3_kPa|Ps3_Pa|kPa
T3_degC|T3_K|degC
T45_avg_degC|T45_K|degC
N_gg_rpm|N1_rpm|rpm
N_pt_rpm|N2_rpm|rpm
M_dyno_Nm|torque_Nm|Nm
P_shaft_kW|power_W|kW
mdot_fuel_g_s|Wf_kg_s|g_s
mdot_air_kg_s|W2_kg_s|kg_s
T_oil_degC|-|
SFC_g_kWh|-|
""",
    ),
    HeaderCase(
        "airline database query, upper case",
        AIRLINER,
        """
AIRCRAFT_REG|-|
ENGINE_SERIAL_NUMBER|text|
FLIGHT_DATE|clock|date
FLIGHT_PHASE_CD|text|CR
STD_ALTITUDE_FT_QTY|altitude_m|ft
MACH_QTY|mach|
TOTAL_AIR_TEMP_C_QTY|TAT_K|degC
FAN_SPEED_N1_PCT_QTY|N1_rpm|pct
CORE_SPEED_N2_PCT_QTY|N2_rpm|pct
EXHAUST_GAS_TEMP_C_QTY|EGT_K|degC
FUEL_FLOW_LBS_HR_QTY|Wf_kg_s|lb_h
EGT_MARGIN_C_QTY|-|
FAN_VIB_QTY|-|
GROSS_WEIGHT_LBS_QTY|-|
""",
    ),
]
FIFTH = [
    HeaderCase(
        "JPI EDM, turbine version",
        TURBOPROP,
        """
DATE|clock|date
TIME|clock|time
OAT|ambient_temperature_K|(degC)
ITT|ITT_K|(degC)
TORQ|torque_Nm|(lbf_ft)
NG|N1_rpm|(pct)
NP|N2_rpm|(rpm)
FF|Wf_kg_s|(gal_h)
USD|-|
OIL-T|-|
OIL-P|-|
BAT|-|
FQL|-|
MARK|-|
PALT|altitude_m|(ft)
IAS|cas_m_s|(kt)
""",
    ),
    HeaderCase(
        "Trent snapshot, take-off report",
        {**AIRLINER, "N1_rpm": 2600.0, "N2_rpm": 7000.0, "N3_rpm": 10500.0},
        """
Engine Serial|text|
Report DateTime|clock|iso
Pressure Altitude|altitude_m|(ft)
Mach|mach|
T20|T2_K|(K)
P20|P2_Pa|(psi)
N1|N1_rpm|(pct)
N2|N2_rpm|(pct)
N3|N3_rpm|(pct)
TGT|EGT_K|(degC)
TPR|-|
P30|P3_Pa|(psi)
T30|T3_K|(K)
P25|P25_Pa|(psi)
T25|T25_K|(K)
Fuel Flow|Wf_kg_s|(lb_h)
VSV|-|
Turbine Case Cooling|-|
""",
    ),
    HeaderCase(
        "Proficy historian, aeroderivative",
        {
            **PLANT,
            "N1_rpm": 9900.0,
            "N2_rpm": 3600.0,
            "P3_Pa": 2.5e6,
            "T3_K": 770.0,
            "Ps3_Pa": 2.5e6,
            "T48_K": 1090.0,
            "P48_Pa": 6.1e5,
        },
        """
TimeStamp|clock|us
LM6K.NHSPD.F_CV (RPM)|N1_rpm|rpm
LM6K.NPTSPD.F_CV (RPM)|N2_rpm|rpm
LM6K.T2AVG.F_CV (DEGF)|T2_K|degF
LM6K.T3AVG.F_CV (DEGF)|T3_K|degF
LM6K.PS3.F_CV (PSIA)|Ps3_Pa|psi
LM6K.T48AVG.F_CV (DEGF)|T48_K|degF
LM6K.P48.F_CV (PSIA)|P48_Pa|psi
LM6K.MW.F_CV (MW)|power_W|MW
LM6K.WFUEL.F_CV (LB/HR)|Wf_kg_s|lb_h
LM6K.VSVPOS.F_CV (PCT)|-|
LM6K.PAMB.F_CV (PSIA)|ambient_pressure_Pa|psi
LM6K.LOTEMP.F_CV (DEGF)|-|
""",
    ),
    HeaderCase(
        "business jet maintenance recorder",
        AIRLINER,
        """
GMT|clock|time
Date|clock|date
Alt(ft)|altitude_m|ft
CAS(kts)|cas_m_s|kt
Mach|mach|
SAT(C)|ambient_temperature_K|degC
TAT(C)|TAT_K|degC
N1 L(%)|N1_rpm|pct
N1 R(%)|N1_rpm|pct
N2 L(%)|N2_rpm|pct
N2 R(%)|N2_rpm|pct
ITT L(C)|ITT_K|degC
ITT R(C)|ITT_K|degC
FF L(pph)|Wf_kg_s|lb_h
FF R(pph)|Wf_kg_s|lb_h
OilT L(C)|-|
OilP L(psi)|-|
A/ICE L|-|
""",
    ),
    HeaderCase(
        "helicopter health file, single engine, metric",
        HELI,
        """
UTC Time|clock|iso
Hp [ft]|altitude_m|ft
KIAS|cas_m_s|kt
OAT [°C]|ambient_temperature_K|degC
N1 [%]|N1_rpm|pct
N2 [%]|N2_rpm|pct
NR [%]|-|
T4.5 [°C]|T45_K|degC
TQ [%]|torque_Nm|pct
FF [kg/h]|Wf_kg_s|kg_h
FLI|-|
MGB OIL T [°C]|-|
""",
    ),
    HeaderCase(
        "MATLAB structure export",
        AIRLINER,
        """
data.t|clock|seconds
data.env.alt_ft|altitude_m|ft
data.env.mach|mach|
data.env.Tamb_K|ambient_temperature_K|K
data.env.Pamb_kPa|ambient_pressure_Pa|kPa
data.eng.Nlp_rpm|N1_rpm|rpm
data.eng.Nhp_rpm|N2_rpm|rpm
data.eng.Wf_kgps|Wf_kg_s|kg_s
data.eng.Tt25_K|T25_K|K
data.eng.Pt25_kPa|P25_Pa|kPa
data.eng.Tt3_K|T3_K|K
data.eng.Pt3_kPa|P3_Pa|kPa
data.eng.Tt45_K|T45_K|K
data.eng.Tt5_K|T5_K|K
data.ctl.PLA_deg|-|
data.ctl.VSV_deg|-|
""",
    ),
    HeaderCase(
        "simple-cycle plant, daily log, French",
        PLANT,
        """
Date|clock|date
Heure|clock|time
Température ambiante (°C)|ambient_temperature_K|degC
Pression atmosphérique (mbar)|ambient_pressure_Pa|mbar
Humidité relative (%)|relative_humidity|pct
Vitesse de rotation (tr/min)|N1_rpm|rpm
Température sortie compresseur (°C)|T3_K|degC
Pression sortie compresseur (bar)|P3_Pa|bar
Température échappement (°C)|EGT_K|degC
Débit combustible (kg/s)|Wf_kg_s|kg_s
Puissance active (MW)|power_W|MW
Température huile (°C)|-|
""",
        delimiter=";",
    ),
    HeaderCase(
        "compressor station, two-shaft driver",
        {
            **PLANT,
            "N1_rpm": 14300.0,
            "N2_rpm": 13800.0,
            "power_W": 5.0e6,
            "T5_K": 780.0,
            "T45_K": 780.0,
            "Wf_kg_s": 0.4,
        },
        """
Timestamp|clock|iso
GG Speed NGP (%)|N1_rpm|pct
PT Speed NPT (%)|N2_rpm|pct
GG Inlet Temperature T1 (°F)|T1_K|degF
Compressor Discharge Pressure PCD (psig)|P3_Pa|psig
Fuel Gas Flow (lb/hr)|Wf_kg_s|lb_h
Fuel Gas Supply Pressure (psig)|-|
Gas Compressor Suction Pressure (psig)|-|
Gas Compressor Discharge Pressure (psig)|-|
Gas Compressor Discharge Temp (°F)|-|
Ambient Temperature (°F)|ambient_temperature_K|degF
Ambient Pressure (psia)|ambient_pressure_Pa|psi
Seal Gas DP (psid)|-|
""",
    ),
    HeaderCase(
        "turbofan test bench, station names with probes",
        AIRLINER,
        """
TIME_SEC|clock|seconds
BARO_PSIA|ambient_pressure_Pa|psi
TCELL_DEGF|ambient_temperature_K|degF
NL_RPM|N1_rpm|rpm
NH_RPM|N2_rpm|rpm
FNM_LBF|Fn_N|lbf
WFM_PPH|Wf_kg_s|lb_h
T2AVG_DEGF|T2_K|degF
P2AVG_PSIA|P2_Pa|psi
T13AVG_DEGF|T13_K|degF
P13AVG_PSIA|P13_Pa|psi
T25AVG_DEGF|T25_K|degF
T3AVG_DEGF|T3_K|degF
PS3_PSIA|Ps3_Pa|psi
T49AVG_DEGF|T49_K|degF
OILT_DEGF|-|
VIB1_MILS|-|
""",
    ),
    HeaderCase(
        "twin turboprop commuter, trend notes",
        TURBOPROP,
        """
Datum/Zeit|clock|eu
Flugnr|text|
Höhe (ft)|altitude_m|ft
IAS (kt)|cas_m_s|kt
SAT (°C)|ambient_temperature_K|degC
TQ1 (%)|torque_Nm|pct
TQ2 (%)|torque_Nm|pct
NH1 (%)|N1_rpm|pct
NH2 (%)|N1_rpm|pct
NP1 (%)|N2_rpm|pct
NP2 (%)|N2_rpm|pct
ITT1 (°C)|ITT_K|degC
ITT2 (°C)|ITT_K|degC
FF1 (kg/h)|Wf_kg_s|kg_h
FF2 (kg/h)|Wf_kg_s|kg_h
Bemerkung|-|
""",
        delimiter=";",
    ),
]
SIXTH = [
    HeaderCase(
        "airline performance monitoring, two engines in rows",
        AIRLINER,
        """
Fleet|-|
Reg|-|
Eng Pos|-|
Eng SN|text|
Date|clock|iso
Alt (ft)|altitude_m|ft
Mach|mach|
TAT (°C)|TAT_K|degC
N1 (%)|N1_rpm|pct
N2 (%)|N2_rpm|pct
EGT (°C)|EGT_K|degC
FF (kg/h)|Wf_kg_s|kg_h
EGT Dev (°C)|-|
FF Dev (%)|-|
""",
    ),
    HeaderCase(
        "turbojet trainer, download of the engine monitor",
        AIRLINER,
        """
SAMPLE_TIME_S|clock|seconds
PRESS_ALT_FT|altitude_m|ft
IND_AIRSPEED_KT|cas_m_s|kt
MACH_NO|mach|
ENG_RPM_PCT|N1_rpm|pct
ENG_EGT_DEGC|EGT_K|degC
ENG_FUEL_FLOW_PPH|Wf_kg_s|lb_h
ENG_OIL_PRESS_PSI|-|
ENG_NOZZLE_POS_PCT|-|
OAT_DEGC|ambient_temperature_K|degC
NORMAL_ACCEL_G|-|
""",
    ),
    HeaderCase(
        "SGT plant, monitoring export",
        {**PLANT, "N1_rpm": 9800.0, "N2_rpm": 6600.0, "power_W": 3.2e7, "P3_Pa": 2.0e6, "T3_K": 700.0, "T45_K": 1060.0},
        """
Date Time|clock|eu
Active Power Generator [kW]|power_W|kW
Gas Generator Speed [rpm]|N1_rpm|rpm
Power Turbine Speed [rpm]|N2_rpm|rpm
Compressor Inlet Temperature [°C]|T2_K|degC
Compressor Discharge Temperature [°C]|T3_K|degC
Compressor Discharge Pressure [bar(g)]|P3_Pa|barg
Power Turbine Inlet Temperature [°C]|T45_K|degC
Exhaust Temperature Average [°C]|EGT_K|degC
Fuel Gas Mass Flow [kg/s]|Wf_kg_s|kg_s
Inlet Filter Differential Pressure [mbar]|dP_inlet_Pa|mbar
Ambient Pressure [hPa]|ambient_pressure_Pa|hPa
Relative Humidity [%]|relative_humidity|pct
Vibration Compressor DE [mm/s]|-|
Lube Oil Tank Temperature [°C]|-|
""",
        delimiter=";",
    ),
    HeaderCase(
        "research turbofan, numeric stations",
        AIRLINER,
        """
scan|-|cycles
time [s]|clock|seconds
p_amb [hPa]|ambient_pressure_Pa|hPa
T_amb [K]|ambient_temperature_K|K
n_L [1/min]|N1_rpm|rpm
n_H [1/min]|N2_rpm|rpm
W_f [kg/s]|Wf_kg_s|kg_s
F_N [kN]|Fn_N|kN
p_t2 [kPa]|P2_Pa|kPa
T_t2 [K]|T2_K|K
T_t25 [K]|T25_K|K
p_t25 [kPa]|P25_Pa|kPa
T_t3 [K]|T3_K|K
p_s3 [kPa]|Ps3_Pa|kPa
T_t5 [K]|T5_K|K
""",
        delimiter="\t",
    ),
    HeaderCase(
        "medical helicopter, trend book",
        HELI,
        """
Date|clock|date
A/C|-|
Flight|text|
Zp (ft)|altitude_m|ft
OAT (°C)|ambient_temperature_K|degC
IAS (kt)|cas_m_s|kt
Ng (%)|N1_rpm|pct
Nf (%)|N2_rpm|pct
TOT (°C)|EGT_K|degC
Tq (%)|torque_Nm|pct
FF (kg/h)|Wf_kg_s|kg_h
Eng Oil P (bar)|-|
Remarks|-|
""",
    ),
    HeaderCase(
        "military transport, four turboprops",
        TURBOPROP,
        """
TIME_UTC|clock|iso
PRESSURE_ALTITUDE_FT|altitude_m|ft
TRUE_AIRSPEED_KTS|tas_m_s|kt
OUTSIDE_AIR_TEMP_C|ambient_temperature_K|degC
ENG1_TORQUE_PCT|torque_Nm|pct
ENG2_TORQUE_PCT|torque_Nm|pct
ENG3_TORQUE_PCT|torque_Nm|pct
ENG4_TORQUE_PCT|torque_Nm|pct
ENG1_MGT_C|EGT_K|degC
ENG2_MGT_C|EGT_K|degC
ENG3_MGT_C|EGT_K|degC
ENG4_MGT_C|EGT_K|degC
ENG1_NG_PCT|N1_rpm|pct
ENG2_NG_PCT|N1_rpm|pct
ENG3_NG_PCT|N1_rpm|pct
ENG4_NG_PCT|N1_rpm|pct
ENG1_FF_PPH|Wf_kg_s|lb_h
ENG2_FF_PPH|Wf_kg_s|lb_h
ENG3_FF_PPH|Wf_kg_s|lb_h
ENG4_FF_PPH|Wf_kg_s|lb_h
CARGO_DOOR|-|
""",
    ),
    HeaderCase(
        "microturbine, Modbus register names",
        {**BENCH, "N1_rpm": 68000.0, "power_W": 95000.0},
        """
ts|clock|iso
EngineSpeed_rpm|N1_rpm|rpm
TurbineExitTemp_degC|T5_K|degC
CompressorInletTemp_degC|T2_K|degC
CompressorInletPressure_kPa|P2_Pa|kPa
OutputPower_kW|power_W|kW
FuelMassFlow_g_s|Wf_kg_s|g_s
AmbientTemp_degC|ambient_temperature_K|degC
AmbientPressure_kPa|ambient_pressure_Pa|kPa
InverterTemp_degC|-|
BatteryVoltage_V|-|
FuelInletPressure_kPa|-|
""",
    ),
    HeaderCase(
        "engine deck validation table",
        AIRLINER,
        """
case|-|cycles
ALT [m]|altitude_m|m
XM [-]|mach|
XNL [%]|N1_rpm|pct
XNH [%]|N2_rpm|pct
FN [daN]|-|
WF [kg/s]|Wf_kg_s|kg_s
W2 [kg/s]|W2_kg_s|kg_s
P25 [kPa]|P25_Pa|kPa
T25 [K]|T25_K|K
P3 [kPa]|P3_Pa|kPa
T3 [K]|T3_K|K
T4 [K]|T4_K|K
T45 [K]|T45_K|K
SFC [g/kN/s]|-|
""",
    ),
]
