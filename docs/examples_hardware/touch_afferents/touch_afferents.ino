/* Spikes of touch afferents from an analogue pressure sensor, printed on the serial port.

   Make the header beside this file, for a sensor that is read every millisecond:

       fembridge export-c --parameters fitted_pad --precision float --sensor-ms 1 -o afferents.h

   and replace OFFSET and GAIN_PA by the numbers of

       fembridge calibrate press.csv --force-n 0.05

   where press.csv has the readings of one press. Each line on the port is a spike: time in ms,
   class, cell (0 is the most sensitive).

   The header needs about 4 kB of flash and 1 kB of memory: a board with 32 bits, such as Uno R4,
   Zero, Teensy, ESP32 or Pico. */

#include <stdint.h>

#include "afferents.h"

static const int SENSOR_PIN = A0;
static const float OFFSET = 102.0f;                                 /* reading without load */
static const float GAIN_PA[AFFERENTS_CLASSES] = {86.0f, 68.0f, 1.9f}; /* SA, RA, PC: Pa for 1 */
static const uint32_t STEP_US = (uint32_t)(1000 * AFFERENTS_SENSOR_MS);

static afferents state;
static unsigned char fired[AFFERENTS_ROOM];
static uint32_t next_us, samples;

/* Prints the spikes of a class and returns the block of the next one. */
static const unsigned char *print_spikes(const char *name, const unsigned char *block, int steps,
                                         int cells, int delay, float step_ms)
{
    for (int row = 0; row < steps; row++) {
        const double time_ms = ((double)samples - delay) * AFFERENTS_SENSOR_MS + (row + 1) * step_ms;
        for (int cell = 0; cell < cells; cell++) {
            for (int spike = *block++; spike > 0; spike--) {
                Serial.print(time_ms, 1);
                Serial.print(',');
                Serial.print(name);
                Serial.print(',');
                Serial.println(cell);
            }
        }
    }
    return block;
}

void setup()
{
    Serial.begin(921600);
    afferents_init(&state);
    next_us = micros();
}

void loop()
{
    if ((int32_t)((uint32_t)micros() - next_us) < 0) return; /* also when micros overflows */
    next_us += STEP_US;

    const float signal = analogRead(SENSOR_PIN) - OFFSET;
    afferents_real stress_pa[AFFERENTS_CLASSES];
    for (int k = 0; k < AFFERENTS_CLASSES; k++) stress_pa[k] = GAIN_PA[k] * signal;

    if (afferents_step(&state, stress_pa, fired)) {
        const unsigned char *block = fired;
        block = print_spikes("SA", block, AFFERENTS_SA_STEPS, AFFERENTS_SA_CELLS,
                             AFFERENTS_SA_DELAY, AFFERENTS_SA_STEP_MS);
        block = print_spikes("RA", block, AFFERENTS_RA_STEPS, AFFERENTS_RA_CELLS,
                             AFFERENTS_RA_DELAY, AFFERENTS_RA_STEP_MS);
        print_spikes("PC", block, AFFERENTS_PC_STEPS, AFFERENTS_PC_CELLS,
                     AFFERENTS_PC_DELAY, AFFERENTS_PC_STEP_MS);
    }
    samples++;
}
