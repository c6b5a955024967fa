// Samples kept as buckets, fine ones for seconds and coarse ones for minutes: a plot never has more
// points than pixels.

const BUCKETS = 400; // per span: about one for every other pixel

// The mean, the least and the most of numbers that come one by one; null counts for nothing.
class Spread {
  n = 0;
  sum = 0;
  low = Infinity;
  high = -Infinity;

  add(value) {
    if (value === null || value === undefined) return;
    this.n += 1;
    this.sum += value;
    if (value < this.low) this.low = value;
    if (value > this.high) this.high = value;
  }

  get mean() {
    return this.n ? this.sum / this.n : null;
  }
}

const FIELDS = [
  "target",
  "measured",
  "expected",
  "reachLow",
  "reachHigh",
  "force",
  "voltage",
  "current",
];

class Bucket {
  count = 0;
  touched = 0;

  constructor(number, periodS) {
    this.number = number;
    this.time_s = (number + 0.5) * periodS;
    for (const field of FIELDS) this[field] = new Spread();
  }

  add(sample) {
    this.count += 1;
    this.touched += sample.touching ? 1 : 0;
    for (const field of FIELDS) this[field].add(sample[field]);
  }

  copy() {
    const copy = Object.assign(Object.create(Bucket.prototype), this);
    for (const field of FIELDS) copy[field] = Object.assign(new Spread(), this[field]);
    return copy;
  }
}

export class History {
  constructor(spansS) {
    this.levels = new Map(
      spansS.map((spanS) => [spanS, { periodS: spanS / BUCKETS, buckets: [] }]),
    );
  }

  clear() {
    for (const level of this.levels.values()) level.buckets = [];
  }

  // `sample`: {time_s, touching, and each of FIELDS, null where there is none}, later than all
  // before.
  add(sample) {
    for (const level of this.levels.values()) {
      const number = Math.floor(sample.time_s / level.periodS),
        { buckets } = level;
      if (buckets.at(-1)?.number !== number) buckets.push(new Bucket(number, level.periodS));
      buckets.at(-1).add(sample);
      while (buckets[0].number < number - BUCKETS) buckets.shift();
    }
  }

  // What to draw of a span: {periodS, buckets}; a copy, which stands still. Only the last bucket
  // takes more samples.
  shown(spanS) {
    const { periodS, buckets } = this.levels.get(spanS);
    return {
      periodS,
      buckets: [...buckets.slice(0, -1), ...buckets.slice(-1).map((b) => b.copy())],
    };
  }
}
