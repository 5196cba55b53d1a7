# ruff: noqa
"""Make the CSV files of this folder from a checkout of akita11/SolenoidStrokeMeasureControl.
usage: python convert.py CHECKOUT   (needs openpyxl)
"""

import csv
import sys
from pathlib import Path

import openpyxl

SRC, OUT = Path(sys.argv[1]), Path(__file__).parent


def rows(book, sheet):
    wb = openpyxl.load_workbook(SRC / book, data_only=True)
    return list(wb[sheet].iter_rows(values_only=True))


def g(v, digits=7):
    return v if isinstance(v, str) else f"{v:.{digits}g}"


def write(name, head, body):
    with open(OUT / name, "w", newline="\n") as f:
        w = csv.writer(f, lineterminator="\n")
        w.writerow(head)
        w.writerows([[g(v) for v in r] for r in body])


# 1. LCR meter, inductance over stroke and frequency (CBS07300580)
r = rows("work/SolenoidStroke-L.xlsx", "Sheet1")[1:7]
write(
    "inductance_cbs0730.csv",
    ["caliper_m", "withdrawal_m", "L_100Hz_H", "L_1kHz_H", "L_10kHz_H", "L_100kHz_H"],
    [[a * 1e-3, b * 1e-3, l100 * 1e-3, l1k * 1e-3, l10k * 1e-3, l100k * 1e-3] for a, b, l1k, l10k, l100k, l100 in r],
)

# 2. current after switch-on at three instants, at known inductance (CBS07300580)
body = []
for v in rows("work/Measure_vs_Calc/SolStrokeExp.xlsx", "240508")[4:]:
    if v[0]:
        body.append(["240508", v[0], "", v[1] * 1e-3, "", "", v[2] * 1e-3, v[3], v[4], v[5], v[9], v[10], v[11]])
for v in rows("work/Measure_vs_Calc/SolStrokeExp.xlsx", "240509")[4:]:
    if v[0]:
        body.append(
            [
                "240509",
                v[0],
                v[1] * 1e-3,
                v[2] * 1e-3,
                v[3] * 1e-3,
                v[4] * 1e-3,
                v[5] * 1e-3,
                v[6],
                v[7],
                v[8],
                v[14],
                v[15],
                v[16],
            ]
        )
write(
    "switch_on_cbs0730.csv",
    [
        "sheet",
        "stroke_label",
        "L_100Hz_H",
        "L_1kHz_H",
        "L_10kHz_H",
        "L_100kHz_H",
        "t_on_s",
        "adc_50us",
        "adc_100us",
        "adc_500us",
        "i_50us_A",
        "i_100us_A",
        "i_500us_A",
    ],
    body,
)

# 3. temperature x position x on-time, ten repeats, two PWM rates (four solenoids, 2024-08-05)
head = ["solenoid", "f_pwm_Hz", "temperature_degC", "position_m", "t_on_s", "v0_mean", "v1_mean"]
head += [f"v{k}_{n}" for n in range(1, 11) for k in (0, 1)]
body, first = [], {"SSBH-0830": 8, "CBS0730140": 14, "CB10370380": 8, "CH1284123": 8}
for sol, c in first.items():
    for v in rows("Control_ESP32/SolPosMeas240805.xlsx", sol)[2:]:
        if v[0] is None or v[2] is None:  # the template row of a point not measured
            continue
        for k, f in enumerate((100, 200)):
            reps = list(v[c + 20 * k : c + 20 * k + 20])
            reps = ["" if x is None else x for x in reps]
            body.append([sol, f, v[0], v[1] * 1e-3, v[2 + 3 * k] * 1e-3, v[3 + 3 * k], v[4 + 3 * k]] + reps)
write("two_point_2024.csv", head, body)

# 4. the same with the second board (SSBH-0830, 200 Hz, 2025-01-25)
body = [
    ["SSBH-0830", 200, v[0], v[1] * 1e-3, v[2] * 1e-3, v[3], v[4]]
    for v in rows("Control_ESP32/SolPosMeas250125.xlsx", "SSBH-0830")[2:]
    if v[0] is not None
]
write("two_point_2025.csv", head[:5] + ["v0", "v1"], body)

# 5. plunger swung by hand: only the ADC difference is measured, L and x are the firmware's own estimates
body = []
for line in (SRC / "work/test240513/swing.log").read_text().split("\n"):
    p = line.split()
    if len(p) == 7:
        body.append([int(p[0]), int(p[1]) * 1e-6, int(p[2]), float(p[5]) * 1e-3, float(p[6]) * 1e-3])
write("swing.csv", ["print_index", "t_on_s", "adc_500us_minus_100us", "L_estimated_H", "withdrawal_estimated_m"], body)
