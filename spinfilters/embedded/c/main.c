/* A first program: it filters a recording on this machine and prints the state after each epoch as CSV.
 *
 *   ./spinfilter_main             the short recording of recording.h
 *   ./spinfilter_main - < FILE    rows from standard input: time_s, then wx, wy, wz (rad/s, axes g) of a gyro,
 *                                 or x, y, z, qx, qy, qz, qw (m, q_ig) of poses; commas or blanks; a header is skipped
 *   ./spinfilter_main - TIME      the same from a start state of this time, s: rows up to TIME are skipped
 *
 * On a microcontroller, keep what stands in `take` and bring the values from your sensor.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "spinfilter.h"
#include "spinfilter_moments.h"
#include "start_state.h"
#include "recording.h"

#ifdef SF_HAS_POSE
#define VALUES 7
#define UPDATE sf_update_pose
#else
#define VALUES 3
#define UPDATE sf_update_gyro
#endif

static sf_filter filter;
static double last_time; /* of the belief; not known before the first epoch, unless it is stated */
static int time_known;
static unsigned long epochs, not_used;

/* One epoch: predict to its time, then update. Without a stated time, the first epoch is that of the start state. 0 where the filter
 * goes on. */
static int take(double time, const sf_real *values)
{
  int ahead = SF_OK;
  if (time_known) ahead = sf_predict(&filter, (sf_real)(time - last_time));
  if (ahead != SF_OK && ahead != SF_FAST) return ahead;
  const int status = UPDATE(&filter, values, start_parameters);
  last_time = time;
  time_known = 1;
  ++epochs;
  not_used += status != SF_OK;

  sf_real moments[3];
  sf_principal_moments(filter.x + SF_X_S, moments);
  printf("%.9g", time);
  /* state in the order of spinfilter_config.h, then the principal moments */
  for (int k = 0; k < SF_NX; ++k) printf(",%.9g", (double)filter.x[k]);
  for (int k = 0; k < 3; ++k) printf(",%.9g", (double)moments[k]);
  printf(",%d\n", status != SF_OK ? status : ahead);
  return 0;
}

static int refuse(unsigned long line, const char *why)
{
  fprintf(stderr, "line %lu: %s\n", line, why);
  return 2;
}

/* Rows of standard input. 0, or 2 at the first line that is of no use. */
static int filter_input(void)
{
  char text[512];
  /* one line at a time: blank lines, comments and a header are skipped, anything else must be a whole row in time order */
  for (unsigned long line = 1; fgets(text, sizeof text, stdin) != NULL; ++line) {
    double row[1 + VALUES];
    sf_real values[VALUES];
    int count = 0;
    char *at = text;
    if (strlen(text) + 1 == sizeof text) return refuse(line, "is longer than 510 characters");
    at += strspn(at, " \t\r\n");
    if (*at == '\0' || *at == '#') continue;
    /* up to one whole row, commas and blanks between its numbers; it ends early at what is no number */
    for (char *end; count < 1 + VALUES; ++count, at = end + strspn(end, ", \t\r\n")) {
      row[count] = strtod(at, &end);
      if (end == at) break;
    }
    if (count == 0 && epochs == 0) continue; /* a header */
    if (count < 1 + VALUES || *at != '\0') return refuse(line, VALUES == 7 ? "needs 8 numbers: time and pose" : "needs 4 numbers: time and rates");
    if (!isfinite(row[0])) return refuse(line, "its time is not finite");
    if (epochs == 0 && time_known && row[0] <= last_time) continue; /* the start state contains it */
    if (epochs > 0 && !(row[0] > last_time)) return refuse(line, "its time does not lie behind that of the line before");
    for (int k = 0; k < VALUES; ++k) values[k] = (sf_real)row[1 + k];
    if (take(row[0], values) != 0) return refuse(line, "the filter cannot go on to this time");
  }
  return epochs > 0 ? 0 : refuse(1, time_known ? "no row in the input is later than the start state" : "no row in the input");
}

/* Take a text as the time of the start state. 0 where it is no number. */
static int state_time(const char *text)
{
  char *end;
  last_time = strtod(text, &end);
  time_known = end != text && *end == '\0' && isfinite(last_time);
  return time_known;
}

int main(int count, char **arguments)
{
  if (count > 3 || (count > 1 && strcmp(arguments[1], "-") != 0) || (count == 3 && !state_time(arguments[2]))) {
    fprintf(stderr, "usage: %s [- [TIME]]   (with - rows come from standard input; TIME is that of the start state, s)\n", arguments[0]);
    return 2;
  }
  if (sf_begin(&filter, start_x, start_covariance, start_psd[0], start_psd[1]) != SF_OK) return refuse(0, "the start state is none");
  printf("time_s," START_COLUMNS ",moment_1,moment_2,moment_3,status\n");
  int status = 0;
  if (count > 1)
    status = filter_input();
  else
    /* epochs of recording.h at a fixed interval */
    for (int k = 0; k < RECORDING_EPOCHS && status == 0; ++k) status = take(RECORDING_INTERVAL * k, recording + VALUES * k);
  if (filter.refused >= 3)
    fprintf(stderr, "the filter is lost: the start state does not fit these rows. Put your own into start_state.h (spinfilters embed --from-run), and "
                    "give its time if the rows begin at another one: - TIME\n");
  fprintf(stderr, "%lu epochs, %lu of them not used; the filter takes %lu bytes\n", epochs, not_used, (unsigned long)sizeof filter);
  return status;
}
