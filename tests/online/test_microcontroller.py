"""The program for a microcontroller in the documentation: what it sends is read, compiled where there is a compiler."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.online.buffer import rows_of
from fg_nav.online.rows import RowReader
from tests.online.walks import short_walk

PAGE = Path(__file__).parents[2] / "docs/microcontroller.md"
(PROGRAM,) = re.findall(r"```cpp\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
ACC, GYR = GRAVITY_M_S2 / 2048, np.radians(2000.0) / 32768
"""Of a count, m/s^2 and rad/s: ranges of 16 g and 2000 deg/s in 16 bits with a sign."""

BOARD = r"""
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
enum { WL_CONNECTED = 3 };
static int64_t clock_us = 0;
int64_t esp_timer_get_time() { return clock_us += 7; }
void delay(int) {}
struct { void begin(const char *, const char *) {} int status() { return WL_CONNECTED; } } WiFi;
struct {
  int settings[256] = {}, sent[8], count = 0, place = 0;
  unsigned char bytes[14];
  void begin() {}
  void setClock(int) {}
  void beginTransmission(int address) { if (address != 0x68) exit(2); count = 0; }
  void write(int value) { sent[count++] = value; }
  void endTransmission(bool stop = true) { if (stop && count == 2) settings[sent[0]] = sent[1]; }
  void requestFrom(int address, int n) {
    bool is_ready = settings[0x6B] == 1 && settings[0x1B] == 0x18 && settings[0x1C] == 0x18;
    if (address != 0x68 || sent[0] != 0x3B || n != 14 || !is_ready) exit(3);
    if (fread(bytes, 1, 14, stdin) != 14) exit(0);
    place = 0;
  }
  int read() { return bytes[place++]; }
} Wire;
struct WiFiUDP {
  void beginPacket(const char *, int) {}
  void write(const uint8_t *data, int n) { fwrite(data, 1, n, stdout); }
  void endPacket() { fflush(stdout); }
};
#include "sketch.ino"
int main() { setup(); for (;;) loop(); }
"""


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++")
def test_it_sends_what_the_sensor_measured(tmp_path):
    # Registers of the sensor on a short walk, (N, 7): acc, temperature, gyr.
    walk = rows_of(short_walk())
    both = np.column_stack([walk[:, 1:4] / ACC, np.full(len(walk), 777.0), walk[:, 4:7] / GYR])
    counts = np.clip(np.rint(both), -32768, 32767).astype(">i2")[: len(walk) // 4 * 4]
    for name in ("WiFi.h", "WiFiUdp.h", "Wire.h"):
        (tmp_path / name).write_text("")
    (tmp_path / "sketch.ino").write_text(PROGRAM)
    (tmp_path / "board.cpp").write_text(BOARD)
    subprocess.run(["g++", "-std=c++17", "-I.", "board.cpp", "-o", "board"], cwd=tmp_path, check=True)
    sent = subprocess.run([tmp_path / "board"], input=counts.tobytes(), capture_output=True, check=True).stdout
    reader = RowReader("the microcontroller")
    rows = reader.read(sent)
    assert reader.bad == 0
    assert sent.count(b"time_s") == len(counts) // 4
    assert np.allclose(rows[:, 1:4], counts[:, :3] * ACC, atol=6e-6, rtol=0)
    assert np.allclose(rows[:, 4:7], counts[:, 4:] * GYR, atol=6e-7, rtol=0)
    assert np.isnan(rows[:, 7:10]).all()
    assert np.allclose(np.diff(rows[:, 0]), 0.0025, atol=2e-5)
    assert len(PROGRAM.splitlines()) <= 35
