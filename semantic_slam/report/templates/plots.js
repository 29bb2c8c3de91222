// The plots of a part of the page: each tells its values at a keyframe, and where the reader points.
class PlotView {
  constructor(svg) {
    this.svg = svg;
    this.cursor = svg.querySelector(".cursor");
    this.figure = svg.closest(".chart");
    for (const name of ["left", "right", "low", "high"]) this[name] = +svg.dataset[name];
    this.series = this.figure ? JSON.parse(this.figure.dataset.series) : [];
  }

  point(keyframe, i, marked) { // the values at place i of its series, and the line there
    const x = this.left + (keyframe - this.low) / (this.high - this.low) * (this.right - this.left);
    this.cursor.setAttribute("x1", x);
    this.cursor.setAttribute("x2", x);
    this.cursor.setAttribute("visibility", marked ? "visible" : "hidden");
    this.series.forEach((values, row) => {
      const value = values[i];
      this.figure.querySelectorAll("output")[row].textContent = value == null ? "–" : +value.toPrecision(3);
    });
  }

  follow(show) { // calls show(keyframe)
    const pointed = event => {
      const box = this.svg.getBoundingClientRect(), x = (event.clientX - box.left) / box.width * this.svg.viewBox.baseVal.width;
      if (x < this.left || x > this.right) return;
      show(Math.round(this.low + (x - this.left) / (this.right - this.left) * (this.high - this.low)));
    };
    this.svg.addEventListener("pointermove", pointed);
    this.svg.addEventListener("pointerdown", pointed);
  }
}

const plotsIn = part => [...part.querySelectorAll(".plot")].map(svg => new PlotView(svg));
