// What the camera in the hand sees: the object's features on the image plane.
"use strict";

function drawImage({ run, columns, frames, index, now }, canvas) {
  const image = run.image;
  const [pen, width, height] = cleared(canvas, (wide) => wide * image.height / image.width);
  canvas.style.height = height + "px";
  const x = (mu) => width * (0.5 + mu / image.width), y = (nu) => height * (0.5 + nu / image.height);
  const bar = (mu, nu, length, color, thick) => {
    pen.strokeStyle = color;
    pen.lineWidth = thick;
    pen.beginPath();
    pen.moveTo(x(mu - length / 2), y(nu));
    pen.lineTo(x(mu + length / 2), y(nu));
    pen.stroke();
  };
  pen.strokeStyle = "rgba(26, 153, 89, 0.5)";
  pen.lineWidth = 1;
  pen.beginPath();
  for (let i = 0; i <= index; i++) pen.lineTo(x(frames[i][columns.image]), y(frames[i][columns.image + 1]));
  pen.stroke();
  if (image.goal) bar(image.goal[0], image.goal[1], image.goal[2], "rgba(0, 114, 178, 0.40)", 9);
  bar(now[columns.image], now[columns.image + 1], now[columns.image + 2], "#1a9959", 4);
  pen.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--ink");
  pen.font = "11px system-ui, sans-serif";
  pen.fillText("image plane: object (green), goal (blue)", 6, 14);
}
