/* Generated with spinfilter_model.h; not to be edited. */
#ifndef SPINFILTER_CONFIG_H
#define SPINFILTER_CONFIG_H

#define SF_HAS_POSE
#define SF_STATE "t 3, q 4, v 3, w 3, c 3, s 5" /* of x; errors: t, a, v, w, c, s, one number less for q */
#define SF_NX 21
#define SF_N 20
#define SF_MOVING 12
#define SF_NOISE 12
#define SF_A 3
#define SF_S 15
#define SF_X_Q 3
#define SF_X_W 10
#define SF_X_S 16
#define SF_SEEN 0
#define SF_SEEN_COUNT 6
#define SF_PHI_COUNT 108
#define SF_G_COUNT 39
#define SF_SUBSTEPS 2
#define SF_LARGEST_TURN 0.16
#define SF_GATE_3 21.107513
#define SF_GATE_6 27.856341
#define SF_CONFIRMED 2
#define SF_WRONG_IN_A_ROW 3

#define SF_PATTERN /* of the moving rows of transition and noise factor, for spinfilter_predict.c alone */ \
  static const unsigned char sf_phi_start[] = {0, 16, 32, 48, 59, 70, 81, 82, 83, 84, 92, 100, 108}; \
  static const unsigned char sf_phi_column[] = {0, 3, 4, 5, 6, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 1, 3, 4, 5, \
    7, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 2, 3, 4, 5, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 3, 4, 5, \
    9, 10, 11, 15, 16, 17, 18, 19, 3, 4, 5, 9, 10, 11, 15, 16, 17, 18, 19, 3, 4, 5, 9, 10, 11, 15, 16, 17, 18, 19, 6, \
    7, 8, 9, 10, 11, 15, 16, 17, 18, 19, 9, 10, 11, 15, 16, 17, 18, 19, 9, 10, 11, 15, 16, 17, 18, 19}; \
  static const unsigned char sf_g_start[] = {0, 4, 8, 12, 13, 15, 18, 20, 22, 24, 28, 33, 39}; \
  static const unsigned char sf_g_column[] = {0, 1, 2, 6, 0, 1, 2, 7, 0, 1, 2, 8, 0, 0, 1, 0, 1, 2, 6, 9, 7, 10, 8, \
    11, 0, 1, 2, 3, 0, 1, 2, 3, 4, 0, 1, 2, 3, 4, 5}; \
  static const unsigned char sf_row_end[] = {24, 24, 24, 24, 24, 24, 24, 24, 24, 18, 18, 18}; \
  static const sf_real sf_weight[] = {(sf_real)0.3333333333333333, (sf_real)1.3333333333333333, (sf_real)0.3333333333333333}

#endif
