// Three controllers (can_top of OpenCores, PeliCAN mode) on one wire. The first sends one frame, once.
//
// cases.txt, one a line: identifier, length, 8 bytes, TEC and REC of each node before, mask of the
// nodes that see a bit wrong, its index, bits of the frame. Printed, one a line: frames received by
// each node, then TEC, then REC.
`timescale 1ns / 1ns
module three_controllers;
  localparam BIT = 16;  // clocks: 8 quanta of 2
  reg clk = 0, rst = 1;
  always #5 clk = ~clk;
  reg [7:0] address = 0, value = 0;
  reg [2:0] strobe = 0, flip = 0;
  wire [2:0] tx;
  wire [2:0] seen = {3{&tx}} ^ flip;
  genvar n;
  generate
    for (n = 0; n < 3; n = n + 1) begin : node
      can_top can (
          .wb_clk_i(clk), .wb_rst_i(rst), .wb_dat_i(value), .wb_dat_o(), .wb_cyc_i(strobe[n]),
          .wb_stb_i(strobe[n]), .wb_we_i(1'b1), .wb_adr_i(address), .wb_ack_o(), .clk_i(clk),
          .rx_i(seen[n]), .tx_o(tx[n]), .bus_off_on(), .irq_on(), .clkout_o());
      integer received = 0;
      reg was_writing = 0;
      always @(posedge clk) begin
        if (can.i_can_bsp.wr_fifo & ~was_writing) received = received + 1;
        was_writing <= can.i_can_bsp.wr_fifo;
      end
    end
  endgenerate

  task put(input [2:0] nodes, input [7:0] where, input [7:0] what);
    begin
      @(negedge clk) address = where; value = what; strobe = nodes;
      repeat (7) @(negedge clk); strobe = 0;
      repeat (9) @(negedge clk);
    end
  endtask

  integer file, k, id, length, mask, index, bits;
  integer data[0:7], tec[0:2], rec[0:2];
  initial begin
    file = $fopen("cases.txt", "r");
    while ($fscanf(file, "%d %d", id, length) == 2) begin
      for (k = 0; k < 8; k = k + 1) if ($fscanf(file, "%d", data[k]) != 1) $finish;
      for (k = 0; k < 3; k = k + 1) if ($fscanf(file, "%d %d", tec[k], rec[k]) != 2) $finish;
      if ($fscanf(file, "%d %d %d", mask, index, bits) != 3) $finish;
      rst = 1; flip = 0; repeat (4) @(negedge clk);
      rst = 0; repeat (4) @(negedge clk);
      put(7, 31, 8'h80);  // PeliCAN
      put(7, 6, 8'h00); put(7, 7, 8'h14);  // bit timing
      for (k = 16; k < 20; k = k + 1) begin put(7, k, 0); put(7, k + 4, 8'hff); end  // receive all
      for (k = 0; k < 3; k = k + 1) begin put(1 << k, 15, tec[k]); put(1 << k, 14, rec[k]); end
      put(7, 0, 8'h00);  // leave reset
      repeat (14 * BIT) @(negedge clk);
      node[0].received = 0; node[1].received = 0; node[2].received = 0;
      put(1, 16, length); put(1, 17, id >> 3); put(1, 18, id << 5);
      for (k = 0; k < 8; k = k + 1) put(1, 19 + k, data[k]);
      put(1, 1, 8'h03);  // send once
      wait (&tx == 0);
      @(negedge clk);
      for (k = 0; k < (bits + 12) * BIT; k = k + 1) begin
        flip = k / BIT == index ? mask : 0;
        @(negedge clk);
      end
      $display("%0d %0d %0d %0d %0d %0d %0d %0d %0d",
          node[0].received, node[1].received, node[2].received,
          node[0].can.i_can_bsp.tx_err_cnt, node[1].can.i_can_bsp.tx_err_cnt,
          node[2].can.i_can_bsp.tx_err_cnt, node[0].can.i_can_bsp.rx_err_cnt,
          node[1].can.i_can_bsp.rx_err_cnt, node[2].can.i_can_bsp.rx_err_cnt);
    end
    $finish;
  end
endmodule
