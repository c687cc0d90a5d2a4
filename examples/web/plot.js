// A line over the last ten seconds, from zero to its largest value.
export class Plot {
  constructor(canvas, colour, seconds = 10) {
    this.canvas = canvas;
    this.colour = colour;
    this.seconds = seconds;
    this.clear();
  }

  clear() {
    this.points = [];
    this.draw();
  }

  add(time, value) {
    this.points.push([time, value]);
    while (this.points[0][0] < time - this.seconds) this.points.shift();
  }

  draw() {
    const { canvas, points } = this;
    const ratio = devicePixelRatio, width = canvas.clientWidth * ratio, height = canvas.clientHeight * ratio;
    if (canvas.width !== Math.round(width) || canvas.height !== Math.round(height)) {
      canvas.width = width;
      canvas.height = height;
    }
    const draw = canvas.getContext('2d');
    draw.clearRect(0, 0, canvas.width, canvas.height);
    if (points.length < 2) return;
    const most = Math.max(...points.map((p) => p[1])) || 1;
    const start = Math.max(points[0][0], points.at(-1)[0] - this.seconds);
    const x = (time) => ((time - start) / this.seconds) * canvas.width;
    const y = (value) => canvas.height - 3 * ratio - (value / most) * (canvas.height - 8 * ratio);
    draw.beginPath();
    for (const [time, value] of points) draw.lineTo(x(time), y(value));
    draw.strokeStyle = this.colour;
    draw.lineWidth = 1.6 * ratio;
    draw.lineJoin = 'round';
    draw.stroke();
    draw.lineTo(x(points.at(-1)[0]), canvas.height);
    draw.lineTo(x(points[0][0]), canvas.height);
    draw.fillStyle = this.colour + '2e';
    draw.fill();
  }
}
