// The ripple that a carrier leaves in friction, at twice its frequency.

const ROUNDING = 1e-9;

// Its frequency, its place among the bands, and whether it is felt; `rule` as of `GET /carrier`.
export function rippleWords(carrier_hz, rule) {
  const hz = 2 * carrier_hz,
    edges = rule.bands_hz;
  const passed = edges.filter((edge) => edge <= hz * (1 + ROUNDING)).length;
  let place = `in the band of ${edges[passed - 1]?.toFixed(0)} to ${edges[passed]?.toFixed(0)} Hz`;
  if (passed === 0) place = "below the bands";
  if (passed === edges.length) place = "above the bands";
  const felt = hz < rule.quiet_above_hz * (1 - ROUNDING) ? "felt" : "not felt";
  return `${Number(hz.toPrecision(4))} Hz, ${place}: ${felt}`;
}
