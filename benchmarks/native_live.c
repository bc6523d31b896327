/* Both ends of a pty, minimal: `send FD N RATE` writes ORIENTATION frames at a steady rate, each with the monotonic
 * clock (us, 32 bits) as its device time; `read PATH N` decodes them and prints latencies and CPU time.
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

static uint16_t crc16(const uint8_t *data, size_t n)
{
    uint16_t crc = 0xFFFF;
    while (n--) {
        uint8_t x = (uint8_t)((crc >> 8) ^ *data++);
        x ^= x >> 4;
        crc = (uint16_t)((crc << 8) ^ (x << 12) ^ (x << 5) ^ x);
    }
    return crc;
}

static uint32_t now_us(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint32_t)((uint64_t)t.tv_sec * 1000000u + (uint64_t)t.tv_nsec / 1000u);
}

static int send_frames(int fd, long n, double rate)
{
    struct timespec due;
    clock_gettime(CLOCK_MONOTONIC, &due);
    for (long k = 0; k < n; k++) {
        due.tv_nsec += (long)(1e9 / rate);
        while (due.tv_nsec >= 1000000000L) {
            due.tv_nsec -= 1000000000L;
            due.tv_sec++;
        }
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
        uint8_t packet[18], frame[21];
        const double half = 0.25 * (1.0 - cos(2.0 * M_PI * (double)k / rate / 2.0));
        const int16_t q[4] = {(int16_t)lrint(32767 * cos(half)), 0, 0, (int16_t)lrint(32767 * sin(half))};
        const uint16_t sequence = (uint16_t)k;
        const uint32_t time_us = now_us();
        packet[0] = 2;
        memcpy(packet + 1, &sequence, 2);
        memcpy(packet + 3, &time_us, 4);
        memcpy(packet + 7, q, 8);
        packet[15] = 8;
        const uint16_t crc = crc16(packet, 16);
        memcpy(packet + 16, &crc, 2);
        frame[0] = frame[20] = 0;
        uint8_t code = 1;
        for (int at = 17; at >= 0; at--) {
            frame[at + 2] = packet[at] ? packet[at] : code;
            code = packet[at] ? (uint8_t)(code + 1) : 1;
        }
        frame[1] = code;
        if (write(fd, frame, sizeof frame) != (ssize_t)sizeof frame) return 1;
    }
    return 0;
}

static int by_size(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

static int read_frames(const char *path, long n)
{
    const int fd = open(path, O_RDWR | O_NOCTTY);
    struct termios raw;
    if (fd < 0 || tcgetattr(fd, &raw)) return 1;
    cfmakeraw(&raw);
    tcsetattr(fd, TCSANOW, &raw);
    uint32_t *latency = malloc((size_t)n * sizeof *latency);
    double sum = 0.0;
    uint8_t buffer[65536], piece[256];
    size_t size = 0;
    long got = 0;
    puts("ready");
    fflush(stdout);
    struct rusage before, after;
    getrusage(RUSAGE_SELF, &before);
    while (got < n) {
        const ssize_t count = read(fd, buffer, sizeof buffer);
        if (count <= 0) break;
        for (ssize_t k = 0; k < count; k++) {
            if (buffer[k]) {
                if (size < 255) piece[size++] = buffer[k];
                continue;
            }
            if (size == 19) {
                for (size_t at = 0; at < size;) {
                    const size_t code = piece[at];
                    piece[at] = 0;
                    at += code;
                }
                int16_t q[4];
                uint32_t time_us;
                if (crc16(piece + 1, 16) == (piece[17] | piece[18] << 8) && piece[1] == 2) {
                    memcpy(&time_us, piece + 4, 4);
                    memcpy(q, piece + 8, 8);
                    sum += 1.0 / sqrt((double)q[0] * q[0] + (double)q[1] * q[1] + (double)q[2] * q[2] + (double)q[3] * q[3]);
                    if (got < n) latency[got++] = now_us() - time_us;
                }
            }
            size = 0;
        }
    }
    getrusage(RUSAGE_SELF, &after);
    const double cpu = (double)(after.ru_utime.tv_sec - before.ru_utime.tv_sec + after.ru_stime.tv_sec - before.ru_stime.tv_sec)
        + 1e-6 * (double)(after.ru_utime.tv_usec - before.ru_utime.tv_usec + after.ru_stime.tv_usec - before.ru_stime.tv_usec);
    qsort(latency, (size_t)got, sizeof *latency, by_size);
    if (got) printf("%ld %u %u %.9f %g\n", got, latency[got / 2], latency[got * 99 / 100], cpu, sum);
    return got < n;
}

int main(int argc, char **argv)
{
    if (argc == 5 && !strcmp(argv[1], "send")) return send_frames(atoi(argv[2]), atol(argv[3]), atof(argv[4]));
    if (argc == 4 && !strcmp(argv[1], "read")) return read_frames(argv[2], atol(argv[3]));
    return 2;
}
